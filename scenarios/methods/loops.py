"""Closing loops in the order of the drive: which submaps may overlap, stitch them, let the graph judge."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from scenarios.estimate import TriedStitch
from slam import se2
from slam.posegraph import PoseGraph, optimise
from slam.se2 import Array
from slam.submap import Submap
from stitch.align import NoStitch, Prior, Stitch, align
from stitch.config import AlignConfig
from stitch.verification import Acceptance


@dataclass(frozen=True)
class LoopConfig:
    """How loops are sought.

    A submap spans ``length`` m of drive. Each is stitched to at most ``candidates`` earlier ones whose
    middles may lie within ``reach`` m, no two of them closer than ``spread`` submaps along the drive. The
    search window grows with the graph distance: ``window`` (m at distance zero, m per m, most m),
    ``window_ins`` for an INS, and ``window_angle`` likewise in rad. ``trusted_edge`` m is how long an
    accepted loop counts in that distance, ``broken_edge`` m what a failure adds to it.
    """

    length: float = 3.0
    reach: float = 4.0
    candidates: int = 5
    spread: int = 3
    window: tuple[float, float, float] = (0.8, 0.020, 3.5)
    window_ins: tuple[float, float, float] = (0.4, 0.008, 1.0)
    window_angle: tuple[float, float, float] = (np.radians(5.0), np.radians(0.25), np.radians(20.0))
    trusted_edge: float = 1.0
    broken_edge: float = 15.0
    rounds: int = 2
    align: AlignConfig = field(default_factory=lambda: AlignConfig(acceptance=Acceptance(max_conflict=0.12)))


@dataclass(frozen=True)
class Closed:
    """The graph over submap anchors with its loops, the poses and weights it settled on, and every stitch
    tried."""

    graph: PoseGraph
    poses: Array
    tried: tuple[TriedStitch, ...]


class _Search:
    """The submaps, the stitches tried between them so far, and where the graph puts them now."""

    def __init__(self, submaps: list[Submap], backbone: PoseGraph, source: str, config: LoopConfig) -> None:
        self.submaps, self.backbone, self.config = submaps, backbone, config
        self.window = config.window_ins if source == "ins" else config.window
        self.results: dict[tuple[int, int], Stitch | NoStitch] = {}
        self.poses = backbone.poses
        self.weights: Array = np.zeros(0)
        broken = np.array([a.stop != b.start for a, b in pairwise(submaps)], dtype=float)
        walked = np.linalg.norm(np.diff(backbone.poses[:, :2], axis=0), axis=1)
        self.steps = walked + config.broken_edge * broken
        self.middles = np.array([submap.points.points.mean(axis=0) for submap in submaps])

    def accepted(self) -> list[tuple[tuple[int, int], Stitch]]:
        """Pairs that were stitched, in the order of trying, whatever the graph thinks of them."""
        return [(pair, r) for pair, r in self.results.items() if isinstance(r, Stitch)]

    def distances(self, b: int) -> Array:
        """Metres ``(K,)`` from node b to every node along the drive and over the loops that are trusted."""
        k = len(self.submaps)
        trusted = [pair for (pair, _), w in zip(self.accepted(), self.weights, strict=False) if w > 0.5]
        rows = [*range(k - 1), *(pair[0] for pair in trusted)]
        columns = [*range(1, k), *(pair[1] for pair in trusted)]
        lengths = [*np.maximum(self.steps, 1e-6), *[self.config.trusted_edge] * len(trusted)]
        return dijkstra(
            coo_array((lengths, (rows, columns)), shape=(k, k)).tocsr(), directed=False, indices=b
        )

    def reach(self, distance: Array | float) -> Array:
        """Half width [m] of the search at a graph distance [m]."""
        base, slope, most = self.window
        return np.minimum(base + slope * np.asarray(distance), most)

    def candidates(self, b: int) -> list[int]:
        """Earlier submaps worth trying: the one across a failure, then the nearest, spread along the
        drive."""
        middles = se2.transform(self.poses[: b + 1], self.middles[: b + 1, None])[:, 0]
        apart = np.linalg.norm(middles[:b] - middles[b], axis=1)
        near = apart <= self.config.reach + self.reach(self.distances(b)[:b])
        chosen = [b - 1] if self.submaps[b - 1].stop != self.submaps[b].start else []
        for a in np.argsort(apart, kind="stable"):
            if len(chosen) >= self.config.candidates:
                break
            if near[a] and a != b - 1 and all(abs(a - other) >= self.config.spread for other in chosen):
                chosen.append(int(a))
        return [a for a in chosen if (a, b) not in self.results]

    def prior(self, a: int, b: int) -> Prior:
        """Where the graph expects b seen from a; the search window is its three sigma."""
        distance = float(self.distances(b)[a])
        base, slope, most = self.config.window_angle
        sigma, sigma_angle = float(self.reach(distance)) / 3.0, min(base + slope * distance, most) / 3.0
        return Prior(se2.between(self.poses[a], self.poses[b]), np.diag([sigma, sigma, sigma_angle]) ** 2)

    def graph(self) -> PoseGraph:
        """The backbone with every accepted stitch as a loop."""
        found = self.accepted()
        pairs = np.array([pair for pair, _ in found], dtype=np.int64).reshape(-1, 2)
        T_ab = np.array([stitch.T_a_b for _, stitch in found]).reshape(-1, 3)
        information = np.array([np.linalg.inv(np.asarray(stitch.covariance)) for _, stitch in found]).reshape(
            -1, 3, 3
        )
        return self.backbone.with_loops(pairs, T_ab, information)

    def settle(self) -> None:
        """Let the robust graph place the submaps and judge the stitches."""
        solution = optimise(replace(self.graph(), poses=self.poses))
        self.poses, self.weights = solution.poses, solution.weights


def close(submaps: list[Submap], backbone: PoseGraph, source: str, config: LoopConfig) -> Closed:
    """Stitch submaps to earlier ones in the order of the drive, re-optimising whenever a stitch was
    found.

    ``backbone`` is the graph over the submaps' anchors, node k = submap k; ``source`` tells an INS from
    odometry.
    """
    search = _Search(submaps, backbone, source, config)
    for _ in range(config.rounds):
        asked = len(search.results)
        for b in range(1, len(submaps)):
            tried = {
                (a, b): align(submaps[a], submaps[b], search.prior(a, b), config.align)
                for a in search.candidates(b)
            }
            search.results.update(tried)
            if any(isinstance(result, Stitch) for result in tried.values()):
                search.settle()
        if len(search.results) == asked:
            break
    kept = iter(search.weights)
    stitches = [
        TriedStitch(a, b, result, float(next(kept)) if isinstance(result, Stitch) else None)
        for (a, b), result in search.results.items()
    ]
    return Closed(search.graph(), search.poses, tuple(stitches))
