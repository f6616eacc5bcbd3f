"""Our method scan by scan: every scan is answered when it arrives, from what has been seen until then.

What a scan makes necessary beyond its own pose (stitches, matches to what an accepted stitch has brought
near) waits in two queues, of which each scan takes one piece of work: no scan waits for all of it.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace
from functools import partial

import numpy as np

from scenarios.methods.config import MethodConfig
from slam import se2
from slam.graph.isam2 import IncrementalGraph
from slam.graph.pose_graph import informations
from slam.mapping import keyframes
from slam.mapping.submap import cut
from slam.matching import Reference
from slam.odometry.ego_motion_filter import without_companion_points
from slam.odometry.segmentation import lost_steps
from slam.odometry.track import Verdict
from slam.odometry.tracker import Tracker, tilted_scans
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array
from stitch.align import Stitch, align
from stitch.mapping import backbone as backbones
from stitch.mapping.estimate import Estimate, Live, LoopCandidate
from stitch.mapping.loop_closure import Stitcher, doubted, weighed
from stitch.mapping.pairing import match_pairs, partners
from stitch.mapping.submap_graph import SubmapGraph

KEYFRAME_DISTANCE, KEYFRAME_ANGLE = 0.15, np.radians(7.0)
"""A scan becomes a node this far (m, rad) from the last one."""

SURPRISE = 11.345
"""χ²₃(0.99): a stitch that lies farther from where the graph expects it makes the graph judge all anew."""

NEIGHBOURS, PER_PASS = 6, 3
"""Keyframes that each is matched to, and those of one stretch of the drive: with more, updates take long."""

TILT_WINDOW = 31
"""Scans of the running median of the tilt: of the past alone, half of a longer one would always be late."""

RECENT = 10
"""Scans from which is told whether confidence is lost at the last of them."""

SETTLING = 2
"""Updates after which a loop that moved the graph has settled."""


def run(recording: Recording, config: MethodConfig) -> Estimate:
    """Each scan in turn; the estimate has the final graph's poses, its ``live`` those given on the way."""
    mapper = Mapper(recording, config, partial(align, config=config.loops.align))
    poses, seconds = np.zeros((len(recording), 3)), np.zeros(len(recording))
    for k in range(len(recording)):
        arrived = time.perf_counter()
        poses[k] = mapper.step()
        seconds[k] = time.perf_counter() - arrived
    return mapper.estimate(Live(poses, seconds))


class Mapper:
    """The map as far as it is known: `step` takes in the next scan of the recording and answers its pose.

    Of the recording's rows a step reads those up to its own scan only.
    """

    def __init__(self, recording: Recording, config: MethodConfig, stitch: Stitcher) -> None:
        self.recording, self.config, self.stitch = recording, config, stitch
        self.bundle = replace(config.bundle, neighbours=NEIGHBOURS, per_pass=PER_PASS)
        tilted = tilted_scans(recording, config.frontend.tilt_limit, TILT_WINDOW, centred=False)
        self.tracker = Tracker(recording, config.frontend, tilted)
        self.seen: list[Scan] = []
        self.scans: list[Scan] = []
        self.graph = IncrementalGraph(recording.dead_reckoning[0])
        self.rows: list[
            int
        ] = []  # of each node: its scan, that scan with an index, may it be matched, submap
        self.references: list[Reference] = []
        self.usable: list[bool] = []
        self.piece: list[int] = []
        self.matched_to: list[set[int]] = []
        self.pairs: dict[int, tuple[int, int]] = {}  # edge -> nodes it ties
        self.skeleton = SubmapGraph(recording, config.loops)
        self.loops: dict[tuple[int, int], int] = {}  # submaps -> edge of their stitch in the graph
        self.tried: list[LoopCandidate] = []
        self.open: int | None = None  # scan that the submap being driven began with
        self.steady, self.steps = True, 0
        self.moved = False  # by stitches that came or went since the last update
        self.waiting_stitches: deque[tuple[int, int]] = deque()
        self.waiting_nodes: dict[int, None] = {}

    def step(self) -> Array:
        """Pose ``(3,)`` of the next scan."""
        k, self.moved = len(self.scans), False
        self._see(k)
        self.tracker.step(self.scans[k])
        if self._begins(k) or k == 0 or self._far_from_last_node(k):
            self._add_node(k)
        self._work()
        self.graph.update(SETTLING if self.moved else 1)
        last = self.rows[-1]
        step = se2.between(self.tracker.poses[last], self.tracker.poses[k])
        return se2.compose(self.graph.pose(len(self.rows) - 1), step)

    def estimate(self, live: Live) -> Estimate:
        """The whole drive as the final graph has it, all work done."""
        self._end(len(self.scans))
        while self.waiting_stitches or self.waiting_nodes:
            self._work()
            self.graph.update()
        self.graph.update(SETTLING)
        found, rows, poses = self.tracker.track(), np.array(self.rows), self.graph.poses()
        skeleton = self.skeleton
        drawn = [s.start for s in skeleton.submaps]
        after = None if not drawn else skeleton.graph(poses[np.searchsorted(rows, drawn)])
        return Estimate(
            "slamstitch_online",
            keyframes.carry(found.poses, rows, poses),
            covariance=self.graph.marginals()[keyframes.nearest(rows, len(found))],
            track=found,
            submaps=tuple(skeleton.submaps),
            stitches=weighed(tuple(self.tried), skeleton.weights),
            graph_before=None if after is None else replace(after, poses=found.poses[drawn]),
            graph_after=after,
            live=live,
        )

    # A scan

    def _see(self, k: int) -> None:
        recording = self.recording
        self.seen.append(Scan.from_ranges(recording.ranges[k], recording.angles, recording.laser))
        self.scans.append(without_companion_points(recording, self.seen, k))

    def _far_from_last_node(self, k: int) -> bool:
        step = se2.between(self.tracker.poses[self.rows[-1]], self.tracker.poses[k])
        return bool(np.hypot(step[0], step[1]) >= KEYFRAME_DISTANCE or abs(step[2]) >= KEYFRAME_ANGLE)

    def _add_node(self, k: int) -> None:
        """Scan k as a node, tied to the last one by dead reckoning and to its neighbours by matches."""
        j = len(self.rows)
        if j > 0:
            ends = np.array([self.rows[-1], k])
            last = self.graph.pose(j - 1)
            self.graph.add_node(se2.compose(last, se2.between(*self.tracker.poses[ends])))
            tie = backbones.reckoned(self.recording, self.tracker.poses, ends)
            self.graph.add_edge(j - 1, j, tie.T_ij[0], tie.information[0], bool(tie.heavy_tailed[0]))
            if tie.world_steps is not None:
                steps = tie.world_steps
                self.graph.add_world_step(j - 1, j, steps.displacement[0], float(steps.variance[0]))
        self.rows.append(k)
        self.references.append(Reference(self.scans[k]))
        self.usable.append(bool(self.tracker.track(k).verdict[0] != Verdict.FELL_BACK))
        self.piece.append(-1 if self.open is None else len(self.skeleton.submaps))
        self.matched_to.append(set())
        self._match_node(j)

    def _match_node(self, j: int) -> None:
        """Match node j to its neighbours, as far as that has not been done."""
        if not self.usable[j]:
            return
        poses = self.graph.poses()
        chosen = partners(poses, j, self._allowed(j), self.bundle)
        chosen = np.array([i for i in chosen if i not in self.matched_to[j]], dtype=np.int64)
        if len(chosen) == 0:
            return
        references = [self.references[i] for i in chosen]
        guesses = se2.between(poses[chosen], poses[j])
        found = match_pairs(references, self.references[j], guesses, chosen, self.bundle)
        for i, T_ij, information in zip(found.partners, found.T_ij, found.information, strict=True):
            self.pairs[self.graph.add_edge(int(i), j, T_ij, information)] = int(i), j
            self.matched_to[j].add(int(i))

    def _allowed(self, j: int) -> np.ndarray:
        """Nodes ``(K,)`` bool whose place beside node j is known well enough to match their scans."""
        near = self.skeleton.near(self.piece[j], self.open)
        return np.array(self.usable) & np.isin(self.piece, near)

    # A submap

    def _begins(self, k: int) -> bool:
        """End the submap being driven where confidence is lost or it is long enough; does another begin?"""
        recent = self.tracker.track(max(0, k + 1 - RECENT))
        resting = recent.verdict[-1] == Verdict.SKIPPED
        self.steady = self.steady if resting else not lost_steps(recent, self.config.segmentation)[-1]
        if not self.steady:
            self._end(k)
            self.steps = 0
            return False
        self.steps += not resting
        if self.open is not None:
            if se2.path_length(self.tracker.poses[self.open : k + 1])[-1] < self.config.loops.length:
                return False
            self._end(k, whole=True)
        self.open = k
        return True

    def _end(self, stop: int, whole: bool = False) -> None:
        """The submap being driven ends before scan ``stop``; one that is too short to be one is forgotten."""
        start, self.open = self.open, None
        if start is None:
            return
        number = len(self.skeleton.submaps)
        inside = [n for n, piece in enumerate(self.piece) if piece == number]
        if not whole and (owner := self._belongs_to(start, stop)) < number:
            for n in inside:
                self.piece[n] = owner
            return
        drawn = np.array([self.rows[n] for n in inside if self.usable[n]])
        submap = cut(self.recording, self.scans, self.tracker.poses, start, stop, drawn)
        self.skeleton.add(submap, self.tracker.track())
        self._seek(number)

    def _belongs_to(self, start: int, stop: int) -> int:
        """The submap that scans ``start..stop-1`` before a loss belong to: the next one, or the last one
        where they are little more of it, or none (-1) where they are too few."""
        submaps = self.skeleton.submaps
        if submaps and submaps[-1].stop == start:
            path = se2.path_length(self.tracker.poses[start:stop])[-1]
            return len(submaps) - (path < 0.5 * self.config.loops.length)
        return len(submaps) if self.steps >= self.config.segmentation.least_steps else -1

    def _seek(self, b: int) -> None:
        """Queue the submaps that may overlap submap b."""
        self.skeleton.poses = self.graph.poses()[np.searchsorted(self.rows, self.skeleton.starts)]
        self.waiting_stitches += [(a, b) for a in self.skeleton.candidates(b)]

    # Work that waits

    def _work(self) -> None:
        """One stitch, and one node's matches."""
        if self.waiting_stitches:
            self._try(*self.waiting_stitches.popleft())
        if self.waiting_nodes:
            j = next(iter(self.waiting_nodes))
            del self.waiting_nodes[j]
            self._match_node(j)

    def _try(self, a: int, b: int) -> None:
        """Stitch submaps a and b; a stitch that agrees with the graph counts, another makes it judge anew."""
        skeleton = self.skeleton
        nodes = [int(n) for n in np.searchsorted(self.rows, [skeleton.starts[a], skeleton.starts[b]])]
        skeleton.poses = self.graph.poses()[np.searchsorted(self.rows, skeleton.starts)]
        prior = skeleton.prior(a, b)
        found = self.stitch(skeleton.submaps[a], skeleton.submaps[b], prior)
        result = doubted(found, prior, skeleton.config)
        skeleton.results[a, b] = result
        self.tried.append(LoopCandidate(a, b, result, prior=prior))
        if not isinstance(result, Stitch):
            return
        assert result.covariance is not None
        expected = se2.between(self.graph.pose(nodes[0]), self.graph.pose(nodes[1]))
        off = se2.log(se2.between(expected, result.T_a_b))
        covariance = self.graph.relative_covariance(*nodes) + result.covariance
        if off @ np.linalg.solve(covariance, off) <= SURPRISE:
            skeleton.trust_last()
        else:
            skeleton.judge()
        self._follow_judgement()

    def _follow_judgement(self) -> None:
        """Bring the graph's stitches in line with what is trusted now."""
        trusted = self.skeleton.trusted()
        dropped = [pair for pair in self.loops if pair not in trusted]
        added = [pair for pair in trusted if pair not in self.loops]
        self._withdraw(dropped)
        for a, b in added:
            stitch = trusted[a, b]
            i, j = (int(np.searchsorted(self.rows, self.skeleton.starts[n])) for n in (a, b))
            information = informations(np.array([[a, b]]), np.asarray(stitch.covariance))[0]
            self.loops[a, b] = self.graph.add_edge(i, j, stitch.T_a_b, information)
            self.waiting_nodes |= {n: None for n, piece in enumerate(self.piece) if piece >= b}
        self.moved |= bool(dropped or added)

    def _withdraw(self, dropped: list[tuple[int, int]]) -> None:
        """Take stitches out of the graph, with the matches between distant submaps made while one of them
        counted."""
        if not dropped:
            return
        self.graph.update()  # which the matches of this scan have not seen yet
        since = min(self.loops[pair] for pair in dropped)
        distant = {
            edge: nodes
            for edge, nodes in self.pairs.items()
            if edge > since and abs(self.piece[nodes[0]] - self.piece[nodes[1]]) > 1
        }
        self.graph.remove([*(self.loops.pop(pair) for pair in dropped), *distant])
        for edge, (i, j) in distant.items():
            del self.pairs[edge]
            self.matched_to[j].discard(i)
            self.waiting_nodes[j] = None
