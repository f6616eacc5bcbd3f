"""The map scan by scan: every scan is answered when it arrives, from what has been seen until then.

What a scan makes necessary beyond its own pose (stitches, matches to what an accepted stitch has brought
near) waits in two queues, of which each scan takes one piece of work: no scan waits for all of it.
"""

from __future__ import annotations

import time as clock
from collections import deque
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from slam import se2
from slam.graph.isam2 import IncrementalGraph
from slam.graph.odometry_factors import dead_reckoning_graph, odometry_graph, step_covariance
from slam.graph.pose_graph import PoseGraph, informations
from slam.mapping import keyframes
from slam.mapping.submap import cut
from slam.matching import Reference
from slam.measurements import MeasurementLog
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.ego_motion_filter import filter_scan
from slam.odometry.laser_mount import Mount, find_mount
from slam.odometry.segmentation import lost_steps
from slam.odometry.tilt import TiltDetector
from slam.odometry.track import Verdict
from slam.odometry.tracker import Tracker
from slam.recording import Laser, Recording, Source
from slam.scan import Scan
from slam.se2 import Array
from stitch.align import Stitch, align
from stitch.mapping.bundle import match_keyframe, partners
from stitch.mapping.config import MappingConfig
from stitch.mapping.estimate import Estimate, LoopCandidate, NoEstimate, OnlineResult, rejection_reason
from stitch.mapping.loop_closure import Stitcher, gate_by_belief
from stitch.mapping.submap_graph import SubmapGraph, with_weights


@dataclass(frozen=True)
class Pose:
    """Where the robot is, as far as is known when its scan has arrived.

    ``pose (3,)`` (m, m, rad) in the map frame, which begins at the first dead-reckoned pose; ``covariance
    (3, 3)`` in the body tangent; ``verdict``: whether the scan was matched.
    """

    pose: Array
    covariance: Array
    verdict: Verdict


@dataclass
class _Node:
    """A keyframe in the graph: scan number ``row``, indexed for matching; ``usable`` if it may be matched;
    the number of its ``submap``, -1 for none; the nodes it was ``matched_to``."""

    row: int
    reference: Reference
    usable: bool
    submap: int
    matched_to: set[int] = field(default_factory=set)


def replay_online(recording: Recording, config: MappingConfig = MappingConfig()) -> Estimate | NoEstimate:
    """Each scan of a recording in turn, as a robot would have it; the estimate has the final graph's poses,
    its ``online`` those given on the way.

    The laser's mount is found, and a map that knows it is lost refused, as in `map_recording`. Stamps that go
    backwards, as some logs' do, are held at the last one's.
    """
    mount = find_mount(recording, config.frontend, config.mount, config.mending)
    if isinstance(mount, Mount):
        recording = recording.with_laser_mount(mount.T_robot_laser, "the drive")
    mapper = OnlineMapper(recording.laser, recording.angles, config, recording.source)
    stamps = np.maximum.accumulate(recording.time)
    poses, seconds = np.zeros((len(recording), 3)), np.zeros(len(recording))
    for k in range(len(recording)):
        dead_reckoning = None if recording.source == "none" else recording.dead_reckoning[k]
        attitude = None if recording.attitude is None else recording.attitude[k]
        arrived = clock.perf_counter()
        poses[k] = mapper.process(recording.ranges[k], stamps[k], dead_reckoning, attitude).pose
        seconds[k] = clock.perf_counter() - arrived
    found = mount if isinstance(mount, Mount) else None
    estimate = replace(mapper.estimate(), online=OnlineResult(poses, seconds), laser_mount=found)
    reason = rejection_reason(estimate, config.rejection) if recording.source == "none" else None
    return NoEstimate(estimate.method, reason) if reason else estimate


class OnlineMapper:
    """The map as far as it is known: `process` takes in the next scan and answers its pose.

    ``laser`` and ``angles (B,)`` rad as in `slam.recording.Recording`; ``source`` tells what dead reckoning
    is: "odometry", "ins", or "none" for the laser alone. ``stitch`` aligns two submaps (default: `align` as
    configured).
    """

    def __init__(
        self,
        laser: Laser,
        angles: Array,
        config: MappingConfig = MappingConfig(),
        source: Source = "odometry",
        stitch: Stitcher | None = None,
    ) -> None:
        self.config = config
        online = config.online
        self.bundle = replace(
            config.bundle, neighbours=online.neighbours, per_pass=online.per_pass, radii=online.radii
        )
        self.stitch = partial(align, config=config.loops.align) if stitch is None else stitch
        self.measurements = MeasurementLog(laser, angles, source)
        self.reckoning = DeadReckoning(self.measurements, config.frontend.dead_reckoning)
        self.tracker = Tracker(self.measurements, config.frontend)
        self.tilt = TiltDetector(config.frontend.tilt_limit, config.online.tilt_window)
        self.graph: IncrementalGraph  # from the first scan on
        self.submap_graph = SubmapGraph([], PoseGraph(np.zeros((0, 3))), source, config.loops)
        self._unfiltered: list[Scan] = []
        self._scans: list[Scan] = []
        self._nodes: list[_Node] = []
        self._pairs: dict[int, tuple[int, int]] = {}  # edge -> nodes it ties
        self._loops: dict[tuple[int, int], int] = {}  # submaps -> edge of their stitch in the graph
        self._tried: list[LoopCandidate] = []
        self._open: int | None = None  # scan that the submap being driven began with
        self._steady, self._steps = True, 0
        self._loops_changed = False  # by stitches that came or went since the last update
        self._waiting_stitches: deque[tuple[int, int]] = deque()
        self._waiting_nodes: dict[int, None] = {}

    def process(
        self,
        ranges: Array | Scan,
        time: float,
        dead_reckoning: Array | None = None,
        attitude: Array | None = None,
    ) -> Pose:
        """Pose of the next scan, of ``ranges (B,)`` m (NaN = no return) or made into a `Scan` already.

        ``time`` s; ``dead_reckoning (3,)`` robot pose as reckoned, None exactly where the source is "none";
        ``attitude (2,)`` roll and pitch rad, for every scan or for none. Raises ``ValueError`` naming what
        cannot be used (another shape, time going backwards, a pose that is not finite): the scan is then
        ignored, and the next one may be processed.
        """
        log = self.measurements
        seen = ranges.to_ranges(log.angles, log.laser) if isinstance(ranges, Scan) else ranges
        log.append(seen, time, dead_reckoning, attitude)
        if not isinstance(ranges, Scan):
            ranges = Scan.from_ranges(log.ranges[-1], log.angles, log.laser, self.config.frontend.scan)
        return self._step(ranges, self.tilt.is_tilted(attitude))

    def estimate(self) -> Estimate:
        """The whole drive as the final graph has it, all work done; no scan may follow.

        Raises ``ValueError`` before the first scan.
        """
        if not self._scans:
            raise ValueError("expected at least one scan before the estimate")
        self._end_submap(len(self._scans))
        while self._waiting_stitches or self._waiting_nodes:
            self._work()
            self.graph.update()
        self.graph.update(self.config.online.settling_updates)
        track, rows, poses = self.tracker.track(), self._rows(), self.graph.poses()
        submap_graph = self.submap_graph
        starts = submap_graph.starts
        after = replace(submap_graph.graph(), poses=poses[self._anchors()]) if starts else None
        return Estimate(
            "slamstitch_online",
            keyframes.carry(track.poses, rows, poses),
            covariance=self.graph.marginals()[keyframes.nearest(rows, len(track))],
            track=track,
            submaps=tuple(submap_graph.submaps),
            stitches=with_weights(self._tried, submap_graph.weights),
            graph_before=None if after is None else replace(after, poses=track.poses[starts]),
            graph_after=after,
        )

    # A scan

    def _step(self, scan: Scan, tilted: bool) -> Pose:
        k, self._loops_changed = len(self._scans), False
        self._unfiltered.append(scan)
        self._scans.append(filter_scan(self.measurements, self._unfiltered, k, self.config.ego_motion_filter))
        if k == 0:
            relinearise = self.config.online.relinearise
            self.graph = IncrementalGraph(self.reckoning.poses[0], relinearise)
        self.tracker.step(self._scans[k], tilted)
        if self._begins_submap(k) or k == 0 or self._is_keyframe(k):
            self._add_node(k)
        self._work()
        self.graph.update(self.config.online.settling_updates if self._loops_changed else 1)
        return self._pose(k)

    def _pose(self, k: int) -> Pose:
        """Pose of scan k: the last node's, and the tracker's step from there."""
        j, row = len(self._nodes) - 1, self._nodes[-1].row
        since = self.tracker.track(row, ())
        step = se2.between(since.poses[0], since.poses[-1])
        covariance = self.graph.marginal(j)
        if k > row:
            added = step_covariance(self.reckoning, since, row, self.config.odometry)
            covariance = se2.compose_covariance(covariance, step, added)
        return Pose(se2.compose(self.graph.pose(j), step), covariance, Verdict(int(since.verdict[-1])))

    def _rows(self) -> np.ndarray:
        """Scan numbers ``(K,)`` of the nodes."""
        return np.array([node.row for node in self._nodes])

    def _anchors(self) -> np.ndarray:
        """Nodes ``(S,)`` of the submaps' anchors."""
        return np.searchsorted(self._rows(), self.submap_graph.starts)

    def _is_keyframe(self, k: int) -> bool:
        spacing = self.config.keyframes
        step = se2.between(self.tracker.poses[self._nodes[-1].row], self.tracker.poses[k])
        return bool(np.hypot(step[0], step[1]) >= spacing.distance or abs(step[2]) >= spacing.angle)

    def _add_node(self, k: int) -> None:
        """Scan k as a node, tied to the last one by dead reckoning and to its neighbours by matches."""
        j = len(self._nodes)
        if j > 0:
            self._tie(j - 1, j, np.array([self._nodes[-1].row, k]))
        usable = bool(self.tracker.track(k, ()).verdict[0] != Verdict.FELL_BACK)
        submap = -1 if self._open is None else len(self.submap_graph.submaps)
        self._nodes.append(_Node(k, Reference(self._scans[k]), usable, submap))
        self._match_node(j)

    def _tie(self, i: int, j: int, rows: np.ndarray) -> None:
        """Node j, new, after node i by dead reckoning; these are the scans ``rows (2,)``."""
        before, after = self.tracker.poses[rows]
        self.graph.add_node(se2.compose(self.graph.pose(i), se2.between(before, after)))
        tie = dead_reckoning_graph(self.reckoning, self.tracker.poses, rows, self.config.odometry)
        self.graph.add_edge(i, j, tie.T_ij[0], tie.information[0], bool(tie.heavy_tailed[0]))
        for displacement, variance in zip(
            tie.world_steps.displacement, tie.world_steps.variance, strict=True
        ):
            self.graph.add_world_step(i, j, displacement, float(variance))

    def _match_node(self, j: int) -> None:
        """Match node j to its neighbours, as far as that has not been done."""
        node = self._nodes[j]
        if not node.usable:
            return
        poses = self.graph.poses()
        chosen = partners(poses, j, self._matchable(j), self.bundle)
        chosen = np.array([i for i in chosen if i not in node.matched_to], dtype=np.int64)
        if len(chosen) == 0:
            return
        references = [self._nodes[i].reference for i in chosen]
        guesses = se2.between(poses[chosen], poses[j])
        limit = (self.config.online.max_shift, self.config.online.max_turn)
        known, *matches = match_keyframe(references, node.reference, guesses, self.bundle, limit)
        for i, T_ij, information in zip(chosen[known], *matches, strict=True):
            self._pairs[self.graph.add_edge(int(i), j, T_ij, information)] = int(i), j
            node.matched_to.add(int(i))

    def _matchable(self, j: int) -> np.ndarray:
        """Nodes ``(K,)`` bool whose place beside node j is known well enough to match their scans."""
        graph, loops, number = self.submap_graph, self.config.loops, self._nodes[j].submap
        last = len(graph.submaps) - 1
        near = np.array([number] if number >= 0 else [], dtype=np.int64)
        if number >= 0 and last >= 0:
            distance = graph.distances(min(number, last))
            if number > last:  # the submap being driven
                broken = graph.submaps[-1].stop != self._open
                distance = distance + loops.length + loops.broken_edge * broken
            near = np.append(np.flatnonzero(distance <= self.config.online.match_distance), near)
        usable = np.array([node.usable for node in self._nodes])
        return usable & np.isin([node.submap for node in self._nodes], near)

    # A submap

    def _begins_submap(self, k: int) -> bool:
        """End the submap being driven where confidence is lost or it is long enough; does another begin?"""
        first = max(0, k + 1 - self.config.online.loss_window)
        recent = self.tracker.track(first, (self.config.segmentation.measure,))
        resting = recent.verdict[-1] == Verdict.SKIPPED
        self._steady = self._steady if resting else not lost_steps(recent, self.config.segmentation)[-1]
        if not self._steady:
            self._end_submap(k)
            self._steps = 0
            return False
        self._steps += not resting
        if self._open is not None:
            path = se2.path_length(self.tracker.poses[self._open : k + 1])[-1]
            if path < self.config.loops.length:
                return False
            self._end_submap(k, whole=True)
        self._open = k
        return True

    def _end_submap(self, stop: int, whole: bool = False) -> None:
        """The submap being driven ends before scan ``stop``; one that is too short to be one is forgotten."""
        start, self._open = self._open, None
        if start is None:
            return
        number = len(self.submap_graph.submaps)
        inside = [node for node in self._nodes if node.submap == number]
        if not whole and (owner := self._owner(start, stop)) < number:
            for node in inside:
                node.submap = owner
            return
        drawn = np.array([node.row for node in inside if node.usable] or [start])
        resolution = self.config.submaps.resolution
        submap = cut(self.measurements, self._scans, self.tracker.poses, start, stop, drawn, resolution)
        step = None
        if number > 0:
            ends = np.array([self.submap_graph.submaps[-1].start, start])
            step = odometry_graph(self.reckoning, self.tracker.track(0, ()), ends, self.config.odometry)
        self.submap_graph.add(submap, step)
        self.submap_graph.poses = self.graph.poses()[self._anchors()]
        if number > 0:
            self._waiting_stitches += [(a, number) for a in self.submap_graph.candidates(number)]

    def _owner(self, start: int, stop: int) -> int:
        """The submap that scans ``start..stop-1`` before a loss belong to: the next one, or the last one
        where they are little more of it, or none (-1) where they are too few."""
        submaps = self.submap_graph.submaps
        if submaps and submaps[-1].stop == start:
            path = se2.path_length(self.tracker.poses[start:stop])[-1]
            return len(submaps) - (path < 0.5 * self.config.loops.length)
        return len(submaps) if self._steps >= self.config.segmentation.least_steps else -1

    # Work that waits

    def _work(self) -> None:
        """One stitch, and one node's matches."""
        if self._waiting_stitches:
            self._try_stitch(*self._waiting_stitches.popleft())
        if self._waiting_nodes:
            j = next(iter(self._waiting_nodes))
            del self._waiting_nodes[j]
            self._match_node(j)

    def _try_stitch(self, a: int, b: int) -> None:
        """Stitch submaps a and b; a stitch that agrees with the graph counts, another makes it judge anew."""
        submap_graph = self.submap_graph
        submap_graph.poses = self.graph.poses()[self._anchors()]
        prior = submap_graph.search_prior(a, b)
        result = self.stitch(submap_graph.submaps[a], submap_graph.submaps[b], prior)
        result = gate_by_belief(result, prior, self.config.loops.least_belief)
        submap_graph.results[a, b] = result
        self._tried.append(LoopCandidate(a, b, result, prior=prior))
        if not isinstance(result, Stitch):
            return
        if self._innovation(a, b, result) <= self.config.online.max_innovation:
            submap_graph.trust_last()
        else:
            submap_graph.optimise()
        self._follow_judgement()

    def _innovation(self, a: int, b: int, stitch: Stitch) -> float:
        """Squared Mahalanobis distance of a stitch from where the graph expects it."""
        assert stitch.covariance is not None
        i, j = self._anchors()[[a, b]].tolist()
        off = se2.log(se2.between(se2.between(self.graph.pose(i), self.graph.pose(j)), stitch.T_a_b))
        covariance = self.graph.relative_covariance(i, j) + stitch.covariance
        return float(off @ np.linalg.solve(covariance, off))

    def _follow_judgement(self) -> None:
        """Bring the graph's stitches in line with what is trusted now."""
        trusted = self.submap_graph.trusted()
        dropped = [pair for pair in self._loops if pair not in trusted]
        added = [pair for pair in trusted if pair not in self._loops]
        self._withdraw(dropped)
        for a, b in added:
            stitch = trusted[a, b]
            information = informations(np.array([[a, b]]), np.asarray(stitch.covariance))[0]
            i, j = self._anchors()[[a, b]]
            self._loops[a, b] = self.graph.add_edge(i, j, stitch.T_a_b, information)
            self._waiting_nodes |= {n: None for n, node in enumerate(self._nodes) if node.submap >= b}
        self._loops_changed |= bool(dropped or added)

    def _withdraw(self, dropped: list[tuple[int, int]]) -> None:
        """Take stitches out of the graph, with the matches between distant submaps made while one of them
        counted."""
        if not dropped:
            return
        self.graph.update()  # which the matches of this scan have not seen yet
        since = min(self._loops[pair] for pair in dropped)
        distant = {
            edge: (i, j)
            for edge, (i, j) in self._pairs.items()
            if edge > since and abs(self._nodes[i].submap - self._nodes[j].submap) > 1
        }
        self.graph.remove([*(self._loops.pop(pair) for pair in dropped), *distant])
        for edge, (i, j) in distant.items():
            del self._pairs[edge]
            self._nodes[j].matched_to.discard(i)
            self._waiting_nodes[j] = None
