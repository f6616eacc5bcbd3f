"""Odometry factors: what matching and dead reckoning say between chosen scans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.graph.odometry_factors import (
    LEAST_VARIANCE,
    OdometryFactorConfig,
    dead_reckoning_graph,
    odometry_graph,
    step_covariance,
)
from slam.graph.pose_graph import optimise
from slam.odometry.dead_reckoning import DeadReckoning, DeadReckoningConfig
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.se2 import Array

HandMade = Callable[..., Track]

N = 12
CONFIG = OdometryFactorConfig()
ROWS = np.array([0, 4, 11])
SURE = np.diag([1e6, 1e6, 1e7])


def drive(step: float = 0.11, turn: float = 0.05) -> Array:
    poses = [np.array([1.0, 2.0, 0.3])]
    for _ in range(N - 1):
        poses.append(se2.compose(poses[-1], [step, 0.0, turn]))
    return np.array(poses)


def reckoned(source: str, poses: Array | None = None) -> Recording:
    poses = drive() if poses is None else poses
    n = len(poses)
    return Recording("test", np.arange(n), np.ones((n, 1)), np.zeros(1), Laser(), poses, source)  # type: ignore[arg-type]


def tracked(
    hand_made: HandMade, verdict: Verdict, information: Array = SURE, poses: Array | None = None
) -> Track:
    poses = drive() if poses is None else poses
    verdicts = np.full(len(poses), int(verdict))
    verdicts[0] = Verdict.SKIPPED
    return hand_made(poses, verdicts, information=np.tile(information, (len(poses), 1, 1)))


def tracked_covariance(recording: Recording, track: Track, rows: np.ndarray) -> Array:
    """Covariance ``(3, 3)`` of the track's step between the first two rows."""
    part = replace(
        track,
        poses=track.poses[rows[0] : rows[1] + 1],
        verdict=track.verdict[rows[0] : rows[1] + 1],
        information=track.information[rows[0] : rows[1] + 1],
    )
    return step_covariance(DeadReckoning(recording), part, int(rows[0]), CONFIG)


@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_two_edges_a_step(hand_made: HandMade, source: str) -> None:
    recording = reckoned(source, drive(turn=0.06))
    track = tracked(hand_made, Verdict.MATCHED)
    graph = odometry_graph(DeadReckoning(recording), track, ROWS)
    np.testing.assert_array_equal(graph.edges, [[0, 1], [1, 2], [0, 1], [1, 2]])
    np.testing.assert_allclose(graph.poses, track.poses[ROWS])
    np.testing.assert_allclose(graph.T_ij[:2], se2.between(track.poses[ROWS[:-1]], track.poses[ROWS[1:]]))
    at = recording.dead_reckoning[ROWS]
    np.testing.assert_allclose(graph.T_ij[2:], se2.between(at[:-1], at[1:]))
    assert not np.any(graph.loop)
    assert np.all(np.linalg.eigvalsh(graph.information) >= -1e-9)


def test_an_ins_gives_its_yaw_to_the_edges_and_its_position_to_the_world(hand_made: HandMade) -> None:
    recording = reckoned("ins")
    graph = odometry_graph(DeadReckoning(recording), tracked(hand_made, Verdict.MATCHED), ROWS)
    np.testing.assert_array_equal(graph.information[2:, :2], 0.0)
    yaw = [DeadReckoning(recording).step_covariance(k, k + 1)[2, 2] for k in range(N - 1)]
    np.testing.assert_allclose(graph.information[2:, 2, 2], [1 / np.sum(yaw[:4]), 1 / np.sum(yaw[4:])])
    steps = graph.world_steps
    assert steps is not None
    np.testing.assert_array_equal(steps.edges, [[0, 1], [1, 2]])
    np.testing.assert_allclose(steps.displacement, np.diff(recording.dead_reckoning[ROWS, :2], axis=0))
    np.testing.assert_allclose(steps.variance, 5e-4 * 0.11 * np.array([4, 7]) + 1.8e-5, rtol=1e-6)


def test_wheels_have_no_world_frame(hand_made: HandMade) -> None:
    recording = reckoned("odometry")
    graph = odometry_graph(DeadReckoning(recording), tracked(hand_made, Verdict.MATCHED), ROWS)
    assert len(graph.world_steps) == 0
    expected: Array = np.zeros((3, 3))
    for k in range(4):
        step = se2.between(recording.dead_reckoning[k], recording.dead_reckoning[k + 1])
        expected = se2.compose_covariance(expected, step, DeadReckoning(recording).step_covariance(k, k + 1))
    np.testing.assert_allclose(np.linalg.inv(graph.information[2]), expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_lost_scans_are_as_sure_as_the_dead_reckoning(hand_made: HandMade, source: str) -> None:
    recording, track = reckoned(source), tracked(hand_made, Verdict.FELL_BACK)
    expected: Array = LEAST_VARIANCE * np.eye(3)
    for k in range(4):
        step = se2.between(track.poses[k], track.poses[k + 1])
        P = DeadReckoning(recording).body_covariance(k, k + 1, track.poses[k + 1])
        expected = se2.compose_covariance(expected, step, P)
    found = tracked_covariance(recording, track, ROWS)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_an_edge_is_the_step_it_spans(hand_made: HandMade, source: str) -> None:
    recording, track = reckoned(source), tracked(hand_made, Verdict.MATCHED)
    graph = odometry_graph(DeadReckoning(recording), track, ROWS)
    expected = tracked_covariance(recording, track, ROWS)
    np.testing.assert_allclose(np.linalg.inv(graph.information[0]), expected, rtol=1e-6, atol=1e-14)


def test_the_track_says_nothing_across_lost_scans(hand_made: HandMade) -> None:
    track = tracked(hand_made, Verdict.MATCHED)
    track.verdict[6] = Verdict.FELL_BACK
    graph = odometry_graph(DeadReckoning(reckoned("ins")), track, ROWS)
    assert np.all(np.linalg.eigvalsh(graph.information[0]) > 0.0)
    np.testing.assert_array_equal(graph.information[1], 0.0)


@pytest.mark.parametrize(
    ("source", "heavy"), [("ins", [False, False, True, True]), ("odometry", [False] * 4)]
)
def test_only_an_ins_has_heavy_tails(hand_made: HandMade, source: str, heavy: list[bool]) -> None:
    graph = odometry_graph(DeadReckoning(reckoned(source)), tracked(hand_made, Verdict.MATCHED), ROWS)
    assert graph.heavy_tailed.tolist() == [False, False, source == "ins", source == "ins"]


def test_a_lost_stretch_weighs_less_than_a_matched_one(hand_made: HandMade) -> None:
    recording = reckoned("odometry")
    lost = tracked_covariance(recording, tracked(hand_made, Verdict.FELL_BACK), ROWS)
    matched = tracked_covariance(recording, tracked(hand_made, Verdict.MATCHED), ROWS)
    assert np.all(np.linalg.eigvalsh(lost) > 5.0 * np.linalg.eigvalsh(matched))


def test_matches_against_one_local_map_are_not_independent(hand_made: HandMade) -> None:
    straight = drive(turn=0.0)
    track = tracked(hand_made, Verdict.MATCHED, poses=straight)
    recording = reckoned("odometry", straight)
    once = np.linalg.inv(SURE / CONFIG.match_inflation + np.eye(3) / CONFIG.worst_variance)
    single = tracked_covariance(recording, track, np.array([0, 1]))
    np.testing.assert_allclose(np.diag(single), np.diag(once) + LEAST_VARIANCE, rtol=1e-3)
    # Ten steps of 0.11 m pass 0.5 m twice: two matches' worth of yaw variance, not ten.
    ten = tracked_covariance(recording, track, np.array([0, 10]))
    np.testing.assert_allclose(ten[2, 2], 2.0 * once[2, 2] + LEAST_VARIANCE, rtol=1e-3)


def test_what_a_match_does_not_know_stays_unknown(hand_made: HandMade) -> None:
    corridor = np.diag([0.0, 1e6, 1e7])
    recording = reckoned("odometry", drive(turn=0.0))
    track = tracked(hand_made, Verdict.MATCHED, corridor, drive(turn=0.0))
    along, across, _ = np.diag(tracked_covariance(recording, track, np.array([0, 1])))
    assert along == pytest.approx(CONFIG.worst_variance, rel=1e-3)
    assert across < 1e-4


def test_scans_skipped_at_rest_add_nothing(hand_made: HandMade) -> None:
    rest = np.tile([1.0, 2.0, 0.3], (N, 1))
    P = tracked_covariance(reckoned("odometry", rest), tracked(hand_made, Verdict.SKIPPED, poses=rest), ROWS)
    np.testing.assert_allclose(P, LEAST_VARIANCE * np.eye(3), rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize("source", ["ins", "odometry"])
def test_reckoning_alone_leads_back_to_the_dead_reckoning(source: str) -> None:
    recording = reckoned(source)
    astray = recording.dead_reckoning + np.random.default_rng(1).normal(0.0, 0.05, (N, 3))
    astray[0] = recording.dead_reckoning[0]
    rows = np.arange(N)
    found = optimise(dead_reckoning_graph(DeadReckoning(recording), astray, rows)).poses
    np.testing.assert_allclose(se2.log(se2.between(recording.dead_reckoning, found)), 0.0, atol=1e-5)


def test_matching_outweighs_a_wrong_reckoning(hand_made: HandMade) -> None:
    truth = drive(turn=0.0)
    recording = reckoned("odometry", drive(step=0.13, turn=0.0))
    track = tracked(hand_made, Verdict.MATCHED, poses=truth)
    found = optimise(odometry_graph(DeadReckoning(recording), track, ROWS)).poses
    np.testing.assert_allclose(found[:, :2], truth[ROWS, :2], atol=0.01)


def test_a_single_row(hand_made: HandMade) -> None:
    for source in ("ins", "odometry"):
        graph = odometry_graph(
            DeadReckoning(reckoned(source)), tracked(hand_made, Verdict.MATCHED), np.array([0])
        )
        assert len(graph.edges) == 0
        np.testing.assert_allclose(optimise(graph).poses, graph.poses, atol=1e-12)


def test_without_dead_reckoning_a_weak_tie_to_the_poses_holds_the_graph_together() -> None:
    recording, poses = reckoned("none", np.zeros((N, 3))), drive()
    graph = dead_reckoning_graph(DeadReckoning(recording), poses, ROWS)
    assert len(graph.world_steps) == 0
    np.testing.assert_allclose(graph.T_ij, se2.between(poses[ROWS[:-1]], poses[ROWS[1:]]))
    sigma = np.sqrt(1.0 / graph.information[:, 0, 0])
    seconds = np.diff(recording.time[ROWS])
    np.testing.assert_allclose(sigma, 10.0 * DeadReckoningConfig().speed_sigma * seconds)
