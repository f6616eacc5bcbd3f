"""Bundle adjustment of keyframes: whom it matches, and where it puts them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.graph.odometry_factors import dead_reckoning_graph
from slam.graph.pose_graph import PoseGraph
from slam.matching import Match, MatchConfig, match
from slam.odometry.dead_reckoning import DeadReckoning
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array
from stitch.mapping.bundle import BundleConfig, adjust, choose_pairs, select_map_keyframes

Record = Callable[..., Recording]
Rms = Callable[[Array, Array], float]

QUICK = BundleConfig(neighbours=6, per_pass=3, radii=(0.4, 0.25, 0.15))


def loop(n: int = 24) -> Array:
    """True poses ``(n, 3)`` on a circle of 0.8 m in the room."""
    angle = np.linspace(0.0, 2.0 * np.pi, n)
    return np.column_stack([4.0 + 0.8 * np.sin(angle), 2.0 - 0.8 * np.cos(angle) + 1.0, se2.wrap(angle)])


def astray(truth: Array, seed: int = 1) -> Array:
    """What wheels say of it: a drift of some 10 cm and 5°."""
    rng = np.random.default_rng(seed)
    steps = se2.between(truth[:-1], truth[1:]) + rng.normal(0.0, 1.0, (len(truth) - 1, 3)) * [
        0.01,
        0.01,
        0.02,
    ]
    poses = [truth[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def backbone(recording: Recording) -> PoseGraph:
    return dead_reckoning_graph(DeadReckoning(recording), recording.dead_reckoning, np.arange(len(recording)))


def all_of(recording: Recording) -> np.ndarray:
    return np.ones(len(recording), dtype=bool)


# Whom it matches


def test_neighbours_are_near_earlier_and_usable() -> None:
    rng = np.random.default_rng(2)
    poses = np.cumsum(rng.normal(0.0, 0.5, (80, 3)), axis=0)
    usable = rng.random(80) < 0.8
    config = BundleConfig(neighbours=7, per_pass=3, reach=1.5)
    pairs = choose_pairs(poses, usable, config)
    assert len(pairs) > 50
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    i, j = pairs.T
    assert np.all(i < j)
    assert np.all(usable[i] & usable[j])
    assert np.all(np.linalg.norm(poses[i, :2] - poses[j, :2], axis=1) <= config.reach)
    assert np.max(np.bincount(j)) <= config.neighbours


def test_neighbours_come_from_every_pass() -> None:
    # Three times along the same 2 m and far away in between.
    x = np.concatenate([np.linspace(0, 2, 21), [50.0], np.linspace(0, 2, 21), [50.0], np.linspace(0, 2, 21)])
    poses = np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])
    config = BundleConfig(neighbours=9, per_pass=3, reach=0.5)
    pairs = choose_pairs(poses, np.ones(len(x), dtype=bool), config)
    last = pairs[pairs[:, 1] == len(x) - 1, 0]
    passes = [np.sum((last >= start) & (last < start + 21)) for start in (0, 22, 44)]
    assert passes == [3, 3, 3]
    # The place itself is among those of each pass, the scan just before among the last's.
    assert {20, 42, 63} <= set(last.tolist())


def test_the_latest_passes_come_first_and_the_nearest_scan_of_each_is_in() -> None:
    x = np.concatenate([np.linspace(0, 2, 21), [50.0], np.linspace(0, 2, 21), [50.0, 0.72]])
    poses = np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])

    def of_the_last(most: int) -> list[int]:
        config = BundleConfig(neighbours=most, per_pass=3, reach=0.95)
        pairs = choose_pairs(poses, np.ones(len(x), dtype=bool), config)
        return pairs[pairs[:, 1] == len(x) - 1, 0].tolist()

    # Within reach are 0 .. 16 of each pass; 7 is the nearest, halfway is 8.
    assert of_the_last(3) == [22, 29, 38]
    assert sorted(of_the_last(9)) == [0, 7, 16, 22, 29, 38]


def test_a_scan_by_itself_has_no_neighbours() -> None:
    far = np.column_stack([10.0 * np.arange(5), np.zeros(5), np.zeros(5)])
    assert choose_pairs(far, np.ones(5, dtype=bool), BundleConfig()).shape == (0, 2)
    assert choose_pairs(far[:1], np.ones(1, dtype=bool), BundleConfig()).shape == (0, 2)


# What the map is made of


def along(laps: int, n: int = 41) -> Array:
    """To and fro along 4 m, always looking the same way."""
    x = np.linspace(0.0, 4.0, n)
    to_and_fro = np.concatenate([x[:: 1 if lap % 2 == 0 else -1] for lap in range(laps)])
    return np.column_stack([to_and_fro, np.zeros((laps * n, 2))])


def test_the_map_is_made_of_the_first_passes() -> None:
    poses = along(8)
    for passes in (1, 2, 3):
        made_of = select_map_keyframes(poses, np.ones(len(poses), dtype=bool), BundleConfig(passes=passes))
        assert np.all(made_of[: 41 * passes])
        assert (
            made_of[41 * passes :].sum() <= 41 + 2 * BundleConfig().pass_gap
        )  # to turn round is no second pass
        assert not np.any(made_of[2 * 41 * passes :])


def test_who_looks_the_other_way_sees_something_new() -> None:
    poses = along(3)
    poses[82:, 2] = np.pi
    assert np.all(select_map_keyframes(poses, np.ones(len(poses), dtype=bool), BundleConfig(passes=2))[82:])


def test_the_unmatched_belong_to_what_is_around_them() -> None:
    poses = along(4)
    usable = np.ones(len(poses), dtype=bool)
    usable[[0, 10, 11, 150, 151, 163]] = False
    made_of = select_map_keyframes(poses, usable, BundleConfig(passes=2))
    np.testing.assert_array_equal(made_of[~usable], [True, True, True, False, False, False])
    assert np.all(select_map_keyframes(poses, np.zeros(len(poses), dtype=bool), BundleConfig()))


def test_the_held_are_matched_but_not_among_themselves() -> None:
    poses = along(3)
    held = np.arange(len(poses)) < 82
    usable = np.arange(len(poses)) != 100
    i, j = choose_pairs(poses, usable, BundleConfig(), held).T
    assert np.all(held[i])
    assert set(j.tolist()) == set(range(82, 123)) - {100}


def test_the_held_stay_and_the_others_are_placed_among_them(room: Array, record: Record, rms: Rms) -> None:
    truth = np.concatenate([loop(), loop()])
    astray_twice = np.concatenate([loop(), astray(loop())])
    recording = record(room, truth, astray_twice)
    held = np.arange(len(truth)) < 24
    graph = adjust(scans_of(recording), backbone(recording), all_of(recording), QUICK, held)
    np.testing.assert_array_equal(graph.poses[held], truth[held])
    assert np.linalg.norm(astray_twice[24:, :2] - truth[24:, :2], axis=1).max() > 0.05
    np.testing.assert_allclose(graph.poses[24:, :2], truth[24:, :2], atol=0.01)
    assert rms(graph.poses, truth) < 0.005


# Where it puts them


def test_a_drifted_loop_is_put_right(room: Array, record: Record, rms: Rms) -> None:
    truth = loop()
    recording = record(room, truth, astray(truth))
    graph = adjust(scans_of(recording), backbone(recording), all_of(recording), QUICK)
    assert rms(recording.dead_reckoning, truth) > 0.03
    assert rms(graph.poses, truth) < 0.005
    off = se2.between(se2.between(truth[0], truth), se2.between(graph.poses[0], graph.poses))
    assert np.max(np.abs(off[:, 2])) < np.radians(0.5)


@pytest.mark.parametrize("source", ["odometry", "ins"])
def test_the_pairs_of_the_last_round_become_edges(room: Array, record: Record, source: str) -> None:
    truth = loop()
    recording = record(room, truth, astray(truth), source=source)
    before = backbone(recording)
    graph = adjust(scans_of(recording), before, all_of(recording), QUICK)
    n = len(before.edges)
    np.testing.assert_array_equal(graph.edges[:n], before.edges)
    np.testing.assert_array_equal(graph.information[:n], before.information)
    expected = choose_pairs(before.poses, all_of(recording), QUICK)
    assert {tuple(pair) for pair in graph.edges[n:].tolist()} <= {tuple(pair) for pair in expected.tolist()}
    assert len(graph.edges) - n > 0.9 * len(expected)
    true_steps = se2.between(truth[graph.edges[n:, 0]], truth[graph.edges[n:, 1]])
    off = se2.log(se2.between(true_steps, graph.T_ij[n:]))
    assert np.median(np.abs(off), axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=0.005)
    assert np.all(np.linalg.eigvalsh(graph.information) >= -1e-6)
    assert (len(graph.world_steps) > 0) == (source == "ins")


def test_pairs_carry_the_information_of_a_match_less_what_neighbouring_points_share(
    room: Array, record: Record
) -> None:
    truth = loop()
    recording = record(room, truth, astray(truth))
    scans, before = scans_of(recording), backbone(recording)
    graph = adjust(scans, before, all_of(recording), QUICK)
    config = MatchConfig(
        levels=((QUICK.radii[-1], 1),), fade=QUICK.fade, robust=QUICK.robust, search_shift=0.0
    )
    for k in range(len(before.edges), len(graph.edges), 10):
        i, j = graph.edges[k]
        alone = match(scans[i], scans[j], graph.T_ij[k], "plicp", config=config)
        assert isinstance(alone, Match)
        expected = (
            se2.to_body_covariance(alone.T_reference_scan, alone.information) / BundleConfig().match_inflation
        )
        scale = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            graph.information[k] / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.1
        )


def test_unusable_and_blind_scans_are_not_matched(room: Array, record: Record, rms: Rms) -> None:
    truth = loop()
    recording = record(room, truth, astray(truth))
    ranges = recording.ranges.copy()
    ranges[9] = np.nan
    recording = replace(recording, ranges=ranges)
    usable = np.arange(len(recording)) != 5
    before = backbone(recording)
    graph = adjust(scans_of(recording), before, usable, QUICK)
    matched = graph.edges[len(before.edges) :]
    assert not np.any(np.isin(matched, [5, 9]))
    # Dead reckoning attaches them to the others.
    assert rms(graph.poses, truth) < 0.02


def test_nothing_to_match_leaves_the_backbone(room: Array, record: Record) -> None:
    truth = loop()
    recording = record(room, truth, astray(truth))
    before = backbone(recording)
    graph = adjust(scans_of(recording), before, np.zeros(len(recording), dtype=bool), QUICK)
    assert len(graph.edges) == len(before.edges)
    np.testing.assert_allclose(graph.poses, before.poses, atol=1e-6)


def test_a_single_scan(room: Array, record: Record) -> None:
    recording = record(room, loop()[:1])
    graph = adjust(scans_of(recording), backbone(recording), all_of(recording), QUICK)
    np.testing.assert_allclose(graph.poses, recording.dead_reckoning, atol=1e-12)


def test_nothing_is_claimed_along_a_bare_corridor(corridor: Array, record: Record) -> None:
    truth = np.column_stack([0.2 * np.arange(12), np.zeros(12), np.zeros(12)])
    wheels = truth * [1.1, 1.0, 1.0] + [0.0, 0.03, 0.0] * np.sin(np.arange(12))[:, None]
    wheels[0] = truth[0]
    recording = record(corridor, truth, wheels)
    graph = adjust(scans_of(recording), backbone(recording), all_of(recording), QUICK)
    along, across = graph.information[11:, 0, 0], graph.information[11:, 1, 1]
    assert np.median(along / across) < 2e-5
    # Across, the walls decide; along, only the wheels know, and stay believed.
    np.testing.assert_allclose(graph.poses[:, 1], graph.poses[0, 1], atol=0.01)
    np.testing.assert_allclose(graph.poses[:, 0], wheels[:, 0], atol=0.02)
