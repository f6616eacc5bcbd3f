"""The submaps of a drive that is still going on, and the stitches between them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from slam.graph.pose_graph import PoseGraph, WorldSteps
from slam.mapping.submap import Submap
from slam.odometry.track import Track
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch
from stitch.mapping import backbone as backbones
from stitch.mapping.loop_closure import LoopConfig, Search

NEAR = 15.0
"""Metres of graph distance up to which two submaps are placed well enough for their scans to be matched."""


class SubmapGraph:
    """Submaps, a node each, in the order of the drive.

    ``poses (K, 3)`` are where their anchors are taken to be, ``results`` every stitch tried, ``weights`` how
    far each of those that were found is trusted, in their order.
    """

    def __init__(self, recording: Recording, config: LoopConfig) -> None:
        self.recording, self.config = recording, config
        self.submaps: list[Submap] = []
        self.results: dict[tuple[int, int], Stitch | NoStitch] = {}
        self.weights: Array = np.zeros(0)
        self.poses: Array = np.zeros((0, 3))
        self._steps: list[PoseGraph] = []
        self._backbone: PoseGraph
        self._search: Search
        self._known: dict[int, Array] = {}

    @property
    def starts(self) -> list[int]:
        """The scan that each submap begins with."""
        return [submap.start for submap in self.submaps]

    def add(self, submap: Submap, track: Track) -> None:
        """The next submap of the drive, tied to the one before as ``track`` and dead reckoning have it."""
        if self.submaps:
            ends = np.array([self.submaps[-1].start, submap.start])
            self._steps.append(backbones.tracked(self.recording, track, ends))
        self.submaps.append(submap)
        self._backbone = self._joined()
        self._forget()

    def candidates(self, b: int) -> list[int]:
        """Earlier submaps that may overlap submap b and have not been tried."""
        return self._current().candidates(b) if b > 0 else []

    def prior(self, a: int, b: int) -> Prior | None:
        """Where submap b is expected, seen from submap a; None where that leaves too much open."""
        search = self._current()
        prior = search.prior(a, b)
        return prior if search.usable(prior) else None

    def near(self, piece: int, start: int | None) -> np.ndarray:
        """Submaps within `NEAR` of submap ``piece``; if that is the one being driven, it began with scan
        ``start``."""
        last = len(self.submaps) - 1
        if piece < 0 or last < 0:
            return np.array([piece] if piece >= 0 else [], dtype=np.int64)
        distance = self._distances(min(piece, last))
        if piece > last:
            broken = self.submaps[-1].stop != start
            distance = distance + self.config.length + self.config.broken_edge * broken
        return np.append(np.flatnonzero(distance <= NEAR), piece)

    def _distances(self, b: int) -> Array:
        """Graph distances ``(K,)`` m from submap b, kept until a submap comes or a judgement changes."""
        if b not in self._known:
            alone = len(self.submaps) == 1
            self._known[b] = np.zeros(1) if alone else self._current().distances(b)
        return self._known[b]

    def trust_last(self) -> None:
        """The stitch found last is trusted."""
        self.weights = np.append(self.weights, 1.0)
        self._forget()

    def judge(self) -> None:
        """Let the robust graph of the submaps judge all stitches anew."""
        search = self._current()
        search.settle()
        self.weights = search.weights
        self._forget()

    def trusted(self) -> dict[tuple[int, int], Stitch]:
        """The stitches the map rests on."""
        found = [(pair, result) for pair, result in self.results.items() if isinstance(result, Stitch)]
        return {pair: stitch for (pair, stitch), w in zip(found, self.weights, strict=True) if w > 0.5}

    def graph(self, poses: Array) -> PoseGraph:
        """The graph of the submaps and all stitches found, at ``poses (K, 3)``."""
        return replace(self._search.graph(), poses=poses)

    def _current(self) -> Search:
        self._search.poses, self._search.weights = self.poses, self.weights
        return self._search

    def _forget(self) -> None:
        """What was computed before a submap came or a judgement changed counts no more."""
        self._search = Search(self.submaps, self._backbone, self.recording.source, self.config)
        self._search.results, self._known = self.results, {}

    def _joined(self) -> PoseGraph:
        """The steps from submap to submap as one graph."""
        anchors = np.array([submap.anchor for submap in self.submaps])
        if not self._steps:
            return PoseGraph(anchors, np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
        edges = [step.edges + k for k, step in enumerate(self._steps)]
        told = [step.world_steps for step in self._steps if step.world_steps is not None]
        world = None
        if told:
            world = WorldSteps(
                np.array(list(pairwise(range(len(anchors))))),
                np.concatenate([steps.displacement for steps in told]),
                np.concatenate([steps.variance for steps in told]),
            )
        return PoseGraph(
            anchors,
            np.concatenate(edges),
            np.concatenate([step.T_ij for step in self._steps]),
            np.concatenate([step.information for step in self._steps]),
            world_steps=world,
            heavy_tailed=np.concatenate([step.heavy_tailed for step in self._steps]),
        )
