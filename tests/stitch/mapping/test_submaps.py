"""From track to submaps: where stretches begin, how long they are, and what lies between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.odometry.segmentation import Segment
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from stitch.align import NoStitch, Stitch
from stitch.mapping.estimate import LoopCandidate
from stitch.mapping.loop_closure import reject_inconsistent_loops
from stitch.mapping.submap_graph import LoopConfig
from stitch.mapping.submaps import SubmapConfig, gap_nodes, split_by_length, trim_relocalisation_jump

N = 56


def drive() -> Recording:
    """Once round a circle by an INS; its laser sees nothing."""
    angle = np.linspace(0.0, 2.3 * np.pi, N)
    x, y = 3.0 + 1.7 * np.sin(angle), 2.5 - 1.4 * np.cos(angle)
    poses = np.column_stack([x, y, np.arctan2(1.4 * np.sin(angle), 1.7 * np.cos(angle))])
    return Recording(
        "circle", 0.2 * np.arange(N), np.full((N, 3), np.nan), np.arange(3.0), Laser(), poses, "ins"
    )


@pytest.mark.parametrize("length", [0.5, 1.0, 3.0, 100.0])
def test_splitting_keeps_every_scan_and_limits_the_length(length: float) -> None:
    poses = np.column_stack([0.1 * np.arange(60), np.zeros(60), np.zeros(60)])
    nothing = np.zeros((60, 3, 3))
    verdict = np.full(60, int(Verdict.MATCHED))
    track = Track(poses, verdict, np.arange(-1, 59), nothing, nothing, np.full(60, 9), {})
    stretches = (Segment(0, 25), Segment(27, 60))
    pieces = split_by_length(track, stretches, length)
    covered = np.concatenate([np.arange(p.start, p.stop) for p in pieces])
    np.testing.assert_array_equal(covered, np.setdiff1d(np.arange(60), [25, 26]))
    lengths = [se2.path_length(poses[p.start : p.stop])[-1] for p in pieces]
    assert max(lengths) <= min(1.5 * length, 3.3) + 0.1


def test_splitting_at_rest_is_one_piece() -> None:
    nothing = np.zeros((5, 3, 3))
    track = Track(np.zeros((5, 3)), np.zeros(5), np.arange(-1, 4), nothing, nothing, np.zeros(5), {})
    assert split_by_length(track, (Segment(0, 5),), 1.0) == [Segment(0, 5)]


@pytest.mark.parametrize(
    ("jump_at", "degrees", "start"), [(21, 2.5, 21), (23, -1.4, 23), (24, 2.5, 20), (21, 0.6, 20)]
)
def test_a_piece_begins_where_the_track_turns_as_dead_reckoning_does(
    jump_at: int, degrees: float, start: int
) -> None:
    """A jump within three steps of the failure is made good before the piece begins, a later one not."""
    recording = drive()
    nothing = np.zeros((N, 3, 3))
    poses = recording.dead_reckoning.copy()
    poses[jump_at:, 2] += np.radians(degrees)
    track = Track(poses, np.zeros(N), np.arange(-1, N - 1), nothing, nothing, np.full(N, 9), {})
    assert trim_relocalisation_jump(recording, track, Segment(20, 40), SubmapConfig()) == Segment(start, 40)
    alone = replace(recording, source="none", dead_reckoning=np.zeros((N, 3)))
    assert trim_relocalisation_jump(alone, track, Segment(20, 40), SubmapConfig()).start == 20
    assert trim_relocalisation_jump(recording, track, Segment(0, 40), SubmapConfig()).start == 0


@pytest.mark.parametrize(
    ("off", "kept"), [((0.1, -0.1, 0.02), True), ((0.0, 0.25, 0.0), False), ((0.0, 0.0, -0.03), False)]
)
def test_a_stitch_that_the_bundle_refutes_is_switched_off(off: tuple[float, ...], kept: bool) -> None:
    anchors = np.array([[0.0, 0.0, 0.5], [3.0, 1.0, -2.0]])
    T_a_b = se2.compose(se2.between(*anchors), np.array(off))
    tried = (
        LoopCandidate(0, 1, Stitch(T_a_b, np.eye(3), 9.0, 20.0, 1.0, (), 3.0), weight=1.0),
        LoopCandidate(0, 1, NoStitch("overlap")),
    )
    judged, refused = reject_inconsistent_loops(tried, anchors, LoopConfig().max_residual)
    assert judged.accepted == kept
    assert refused == tried[1]


def test_the_graph_has_nodes_where_nothing_was_matched() -> None:
    poses = np.column_stack([0.3 * np.arange(60), np.zeros(60), np.zeros(60)])
    nothing = np.zeros((60, 3, 3))
    track = Track(poses, np.zeros(60), np.arange(-1, 59), nothing, nothing, np.full(60, 9), {})
    rows = gap_nodes(track, [Segment(8, 20), Segment(20, 30), Segment(40, 60)], 1.0)
    np.testing.assert_array_equal(rows, [0, 4, 7, 8, 29, 33, 36, 39, 40, 59])
