"""The submap graph of a drive that is still going on."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from slam.graph.odometry_factors import OdometryFactorConfig, odometry_graph
from slam.graph.pose_graph import PoseGraph, WorldSteps
from slam.mapping.submap import Submap
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.track import Track
from slam.se2 import Array
from stitch.align import NoStitch, Prior, Stitch
from stitch.mapping.submap_graph import LoopConfig, SubmapGraph


class GrowingSubmapGraph:
    """Submaps, a node each, in the order of the drive.

    ``poses (K, 3)`` are where their anchors are taken to be, ``results`` every stitch tried, ``weights`` how
    far each of those that were found is trusted, in their order. Submaps within ``match_distance`` m of graph
    distance are placed well enough for their scans to be matched.
    """

    def __init__(
        self,
        reckoning: DeadReckoning,
        config: LoopConfig,
        odometry: OdometryFactorConfig,
        match_distance: float,
    ) -> None:
        self.reckoning, self.config = reckoning, config
        self.odometry, self.match_distance = odometry, match_distance
        self.submaps: list[Submap] = []
        self.results: dict[tuple[int, int], Stitch | NoStitch] = {}
        self.weights: Array = np.zeros(0)
        self.poses: Array = np.zeros((0, 3))
        self._steps: list[PoseGraph] = []
        self._graph: SubmapGraph  # of the submaps so far, until one comes or a judgement changes
        self._distances: dict[int, Array] = {}  # by submap, as long

    @property
    def starts(self) -> list[int]:
        """The scan that each submap begins with."""
        return [submap.start for submap in self.submaps]

    def add(self, submap: Submap, track: Track) -> None:
        """The next submap of the drive, tied to the one before as ``track`` and dead reckoning have it."""
        if self.submaps:
            ends = np.array([self.submaps[-1].start, submap.start])
            self._steps.append(odometry_graph(self.reckoning, track, ends, self.odometry))
        self.submaps.append(submap)
        self._rebuild()

    def candidates(self, b: int) -> list[int]:
        """Earlier submaps that may overlap submap b and have not been tried."""
        return self._current().candidates(b) if b > 0 else []

    def search_prior(self, a: int, b: int) -> Prior | None:
        """Where submap b is expected, seen from submap a; None where that leaves too much open."""
        return self._current().search_prior(a, b)

    def near(self, number: int, start: int | None) -> np.ndarray:
        """Submaps within `match_distance` of submap ``number``; if that is the one being driven, it began
        with scan ``start``."""
        last = len(self.submaps) - 1
        if number < 0 or last < 0:
            return np.array([number] if number >= 0 else [], dtype=np.int64)
        distance = self._distances_from(min(number, last))
        if number > last:
            broken = self.submaps[-1].stop != start
            distance = distance + self.config.length + self.config.broken_edge * broken
        return np.append(np.flatnonzero(distance <= self.match_distance), number)

    def trust_last(self) -> None:
        """Trust the stitch found last."""
        self.weights = np.append(self.weights, 1.0)
        self._rebuild()

    def judge(self) -> None:
        """Let the robust graph of the submaps judge all stitches anew."""
        graph = self._current()
        graph.optimise()
        self.weights = graph.weights
        self._rebuild()

    def trusted(self) -> dict[tuple[int, int], Stitch]:
        """The stitches the map rests on."""
        stitches = [(pair, result) for pair, result in self.results.items() if isinstance(result, Stitch)]
        return {pair: stitch for (pair, stitch), w in zip(stitches, self.weights, strict=True) if w > 0.5}

    def pose_graph(self, poses: Array) -> PoseGraph:
        """The graph of the submaps and all stitches found, at ``poses (K, 3)``."""
        return replace(self._graph.graph(), poses=poses)

    def _distances_from(self, b: int) -> Array:
        """Graph distances ``(K,)`` m from submap b."""
        if b not in self._distances:
            alone = len(self.submaps) == 1
            self._distances[b] = np.zeros(1) if alone else self._current().distances(b)
        return self._distances[b]

    def _current(self) -> SubmapGraph:
        self._graph.poses, self._graph.weights = self.poses, self.weights
        return self._graph

    def _rebuild(self) -> None:
        """Forget what was computed before a submap came or a judgement changed."""
        source = self.reckoning.measurements.source
        self._graph = SubmapGraph(self.submaps, self._odometry_graph(), source, self.config)
        self._graph.results, self._distances = self.results, {}

    def _odometry_graph(self) -> PoseGraph:
        """The steps from submap to submap as one graph."""
        anchors = np.array([submap.anchor for submap in self.submaps])
        if not self._steps:
            return PoseGraph(anchors, np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
        edges = [step.edges + k for k, step in enumerate(self._steps)]
        worlds = [step.world_steps for step in self._steps if step.world_steps is not None]
        world_steps = None
        if worlds:
            world_steps = WorldSteps(
                np.array(list(pairwise(range(len(anchors))))),
                np.concatenate([steps.displacement for steps in worlds]),
                np.concatenate([steps.variance for steps in worlds]),
            )
        return PoseGraph(
            anchors,
            np.concatenate(edges),
            np.concatenate([step.T_ij for step in self._steps]),
            np.concatenate([step.information for step in self._steps]),
            world_steps=world_steps,
            heavy_tailed=np.concatenate([step.heavy_tailed for step in self._steps]),
        )
