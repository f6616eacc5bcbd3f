"""A map that is right agrees with itself, a torn one does not and says where; both told without truth."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from sim.laser import Raycaster
from slam import se2
from slam.mapping.scan_agreement import choose_partners, compare_pairs, meetings, misfit
from slam.mapping.self_consistency import (
    NO_REVISIT,
    SelfConsistencyConfig,
    beams_of,
    compare,
    self_consistency,
)
from slam.recording import Laser, Recording
from slam.se2 import Array

N = 120
ANGLES = np.radians(np.linspace(-135.0, 135.0, 91))
LASER = Laser(range_max=10.0, T_robot_laser=np.array([0.2, 0.0, 0.1]))
FULL_TURN = np.radians(np.linspace(-180.0, 178.0, 180))


def box(x: float, y: float, width: float, height: float) -> list[list[float]]:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
    return [[*a, *b] for a, b in pairwise(corners)]


WALLS = np.array(
    box(0, 0, 14, 9)
    + box(3, 3, 8, 3)
    + box(0, 2.5, 0.5, 1)
    + box(6, 0, 1, 0.6)
    + box(13.4, 5, 0.6, 1)
    + box(8, 8.5, 1, 0.5)
)
"""A ring of a corridor with something in each of its sides."""


def around(laps: float) -> Array:
    """Poses ``(N, 3)`` along the ring."""
    corners = np.array([[1.5, 1.5], [12.5, 1.5], [12.5, 7.5], [1.5, 7.5], [1.5, 1.5]])
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    along = np.linspace(0.0, laps * length[-1] - 1e-6, N) % length[-1]
    x, y = (np.interp(along, length, corners[:, k]) for k in (0, 1))
    side = np.searchsorted(length, along, side="right") - 1
    return np.column_stack([x, y, 0.5 * np.pi * side])


def seen_from(poses: Array, noise: float = 0.01) -> Recording:
    ranges = Raycaster.from_segments(WALLS).cast(se2.compose(poses, LASER.T_robot_laser), ANGLES, 10.0)
    ranges = ranges + np.random.default_rng(1).normal(0.0, noise, ranges.shape)
    return Recording("ring", 0.5 * np.arange(N), ranges, ANGLES, LASER, poses.copy())


@pytest.fixture(scope="module")
def twice() -> Recording:
    return seen_from(around(2.0))


def torn(poses: Array, by: Array, row: int = N // 2) -> Array:
    """The drive from ``row`` on moved by ``by (3,)``, as its pose there sees it."""
    moved = se2.compose(se2.compose(poses[row], by), se2.between(poses[row], poses[row:]))
    return np.concatenate([poses[:row], moved])


def test_the_map_at_the_true_poses_agrees_with_itself(twice: Recording) -> None:
    found = self_consistency(twice, twice.dead_reckoning)
    assert found.figure is not None
    assert found.figure > 0.9
    assert not found.torn
    assert found.places == ()
    assert found.revisits > 100


@pytest.mark.parametrize("by", [[0.0, 0.5, 0.0], [0.3, 0.4, 0.0], [0.0, 0.0, np.radians(6.0)]])
def test_a_torn_map_says_so_and_where(twice: Recording, by: list[float]) -> None:
    poses = torn(twice.dead_reckoning, np.array(by))
    found = self_consistency(twice, poses)
    assert found.torn
    assert found.figure < 0.1
    jumps = [place for place in found.places if "follow each other" in place.reason]
    near = [place for place in jumps if np.hypot(place.x - poses[60, 0], place.y - poses[60, 1]) < 3.0]
    assert near
    assert near[0].scans[0] < N // 2 <= near[0].scans[1]
    assert near[0].time == twice.time[near[0].scans[1]]


def test_passes_that_look_through_each_others_walls_are_a_place(twice: Recording) -> None:
    """A second lap a metre beside the first: the walls are too far apart to be taken for each other."""
    poses = twice.dead_reckoning + np.where(np.arange(N) < N // 2, 0.0, 1.2)[:, None] * [0.6, 0.8, 0.0]
    found = self_consistency(twice, poses)
    assert found.share > 0.4
    assert any("looks through" in place.reason for place in found.places)


def test_it_does_not_matter_where_the_map_lies(twice: Recording) -> None:
    poses = torn(twice.dead_reckoning, np.array([0.1, 0.0, 0.0]))
    here = self_consistency(twice, poses)
    there = self_consistency(twice, se2.compose(np.array([50.0, -20.0, 2.0]), poses))
    assert here.figure == pytest.approx(there.figure, rel=1e-3)


def test_a_drive_that_never_comes_back_has_no_figure() -> None:
    once = seen_from(around(0.7))
    found = self_consistency(once, once.dead_reckoning)
    assert found.figure is None
    assert found.reason == NO_REVISIT
    assert not found.torn


def test_a_drive_that_never_comes_back_can_still_be_torn() -> None:
    once = seen_from(around(0.7))
    assert self_consistency(once, torn(once.dead_reckoning, np.array([0.5, 0.5, 0.0]))).torn


@pytest.mark.parametrize("spoil", ["noise", "lost", "persons", "floor"])
def test_what_comes_and_goes_does_not_tear_a_map(twice: Recording, spoil: str) -> None:
    rng = np.random.default_rng(2)
    ranges, attitude = twice.ranges.copy(), np.zeros((N, 2))
    if spoil == "noise":
        ranges += rng.normal(0.0, 0.03, ranges.shape)
    if spoil == "lost":
        ranges[rng.random(ranges.shape) < 0.4] = np.nan
    if spoil == "persons":  # somebody in view of every second scan, each time elsewhere
        for k, first in zip(range(0, N, 2), rng.integers(0, 80, N), strict=False):
            ranges[k, first : first + 10] = np.minimum(ranges[k, first : first + 10], rng.uniform(0.5, 3.0))
    if spoil == "floor":  # the laser nods: every fifth scan sees the floor ahead
        ranges[::5] = np.minimum(ranges[::5], 2.0 / np.maximum(np.cos(ANGLES), 0.1))
        attitude[::5, 1] = np.radians(6.0)
    found = self_consistency(replace(twice, ranges=ranges, attitude=attitude), twice.dead_reckoning)
    assert found.figure is not None
    assert not found.torn
    assert found.places == ()


def test_nothing_seen_and_few_beams_have_no_figure(twice: Recording) -> None:
    blind = replace(twice, ranges=np.full(twice.ranges.shape, np.nan))
    assert self_consistency(blind, twice.dead_reckoning).figure is None
    sparse = replace(twice, ranges=twice.ranges[:, :3], angles=ANGLES[:3])
    assert "few beams" in self_consistency(sparse, twice.dead_reckoning).reason
    one = replace(twice, time=twice.time[:1], ranges=twice.ranges[:1], dead_reckoning=np.zeros((1, 3)))
    assert self_consistency(one, np.zeros((1, 3))).figure is None


def test_poses_of_another_drive_are_refused(twice: Recording) -> None:
    with pytest.raises(ValueError, match=r"poses: expected \(120, 3\), got \(119, 3\)"):
        self_consistency(twice, twice.dead_reckoning[1:])


def test_truth_is_not_looked_at(twice: Recording) -> None:
    poses = torn(twice.dead_reckoning, np.array([0.1, 0.0, 0.0]))
    assert self_consistency(replace(twice, truth=poses), poses) == self_consistency(twice, poses)


# Settings

CHANGED = {
    "spacing": 2.0,
    "spacing_angle": 3.2,
    "most_scans": 20,
    "most_beams": 40,
    "max_tilt": 0.5,
    "radius": 0.3,
    "least_detour": 45.0,
    "detour_factor": 300.0,
    "partners": 1,
    "apart": 0.1,
    "tolerance": 0.3,
    "tolerance_slope": 0.1,
    "half_width": 0.5,
    "gate": 0.2,
    "sigma_wall": 0.5,
    "sigma_shift": 0.01,
    "sigma_turn": 1e-3,
    "noise_factor": 20.0,
    "least_met": 40,
    "least_pairs": 10_000,
    "quantile_revisits": 0.5,
    "quantile_neighbours": 0.5,
    "torn_shift": 0.2,
    "torn_share": 0.6,
    "torn_jump": 0.6,
    "place_shift": 0.05,
    "place_share": 0.05,
    "place_size": 1.0,
    "least_in_place": 8,
}
"""Every setting, and a value with which a torn map is told otherwise."""


@pytest.mark.parametrize("name", [field.name for field in fields(SelfConsistencyConfig)])
def test_every_setting_changes_what_is_told(name: str, twice: Recording) -> None:
    attitude = np.zeros((N, 2))
    attitude[::5, 1] = np.radians(6.0)
    recording = replace(twice, attitude=attitude)
    slightly = name in ("least_pairs", "gate")
    poses = torn(twice.dead_reckoning, np.array([0.02, 0.0, 0.0] if slightly else [0.2, 0.15, 0.02]))
    config = SelfConsistencyConfig(spacing=5.0 if name == "spacing_angle" else 0.5)
    changed = replace(config, **{name: CHANGED[name]})
    assert self_consistency(recording, poses, config) != self_consistency(recording, poses, changed)


# Kernels and their slow twins


def slow_meetings(ranges: Array, angles: Array, points: Array, T_ab: Array, tolerance: Array) -> list[int]:
    told = []
    for point in se2.transform(T_ab, points):
        distance, bearing = np.hypot(*point), np.arctan2(*point[::-1])
        off = np.abs(se2.wrap(angles - bearing))
        step = angles[1] - angles[0]
        if not (distance > 0.0 and off.min() <= 0.5 * step + 1e-9) or np.isnan(ranges[off.argmin()]):
            told.append(0)
            continue
        k, reach = off.argmin(), int(np.ceil(tolerance[2] / distance / step))
        window = ranges[max(k - reach, 0) : k + reach + 1]
        window = window[np.isfinite(window)]
        allowed = tolerance[0] + tolerance[1] * distance
        through = np.all(distance < window - allowed)
        told.append(-1 if through else int(np.any(np.abs(window - distance) <= allowed)))
    return told


@pytest.mark.parametrize("angles", [ANGLES, FULL_TURN, ANGLES[40:70]])
def test_meetings_are_those_of_the_slow_twin(angles: Array) -> None:
    rng = np.random.default_rng(3)
    ranges = np.where(rng.random(len(angles)) < 0.1, np.nan, rng.uniform(1.0, 4.0, len(angles)))
    points = rng.uniform(-4.0, 4.0, (300, 2))
    points[::7] = np.nan
    T_ab, tolerance = np.array([0.4, -0.2, 0.7]), np.array([0.15, 0.02, 0.05])
    told = meetings(ranges, angles, points, T_ab, tolerance)
    assert told.tolist() == slow_meetings(ranges, angles, points, T_ab, tolerance)
    assert set(told.tolist()) == {-1, 0, 1}


@pytest.mark.parametrize("off", [[0.0, 0.0, 0.0], [0.1, -0.05, 0.0], [0.05, 0.05, 0.03]])
def test_the_misfit_is_the_shift_that_was_put_in(twice: Recording, off: list[float]) -> None:
    """The slow twin: the shift is known, and so is what it moves the points by along the walls' normals."""
    quiet = seen_from(twice.dead_reckoning, noise=1e-9)
    rows, prior = np.array([20, 21]), np.array([0.05, 10.0, 10.0])
    a, b = beams_of(quiet, rows)[..., 1:]
    T_ab = se2.between(*se2.compose(quiet.dead_reckoning[rows], LASER.T_robot_laser))
    wrong = se2.compose(np.array(off), T_ab)
    shift, expected, met = misfit(a, b, ANGLES, wrong, 0.6, prior)
    walls = b[np.isfinite(b[:, 2])]
    moved = se2.transform(T_ab, walls[:, :2]) - se2.transform(wrong, walls[:, :2])
    normals = walls[:, 2:] @ se2.rotation(T_ab[2]).T
    assert shift == pytest.approx(np.sqrt(np.mean(np.sum(moved * normals, axis=1) ** 2)), rel=0.25, abs=2e-3)
    assert expected < 0.01
    assert met > 60


def test_partners_are_those_of_the_slow_twin() -> None:
    poses = around(2.5)
    path = se2.path_length(poses)
    found = choose_partners(poses, path, 3, 3.0, np.array([4.0, 2.0]), 2.0)
    expected = []
    for i in range(N):
        distance = np.hypot(*(poses[:i, :2] - poses[i, :2]).T)
        taken: list[int] = []
        for j in np.argsort(distance, kind="stable"):
            other = distance[j] < 3.0 and path[i] - path[j] > 4.0 + 2.0 * distance[j]
            if other and len(taken) < 3 and all(abs(path[j] - path[k]) > 2.0 for k in taken):
                taken.append(int(j))
        expected += [[i, j] for j in taken]
    assert found.tolist() == expected


def test_pairs_are_compared_as_one_by_one(twice: Recording) -> None:
    rows = np.arange(0, N, 10)
    lasers = se2.compose(twice.dead_reckoning[rows], LASER.T_robot_laser)
    beams, tolerance, prior = beams_of(twice, rows), np.array([0.15, 0.02, 0.15]), np.array([0.05, 0.3, 0.1])
    pairs = np.array([[6, 0], [1, 0]])
    told = compare_pairs(
        pairs, np.array([False, False]), lasers, beams, ANGLES, 2, tuple(tolerance), 0.6, prior
    )
    for (a, b), row in zip(pairs, told, strict=True):
        T_ab = se2.between(lasers[a], lasers[b])
        ours = meetings(beams[a, :, 0], ANGLES, beams[b, ::2, 1:3], T_ab, tolerance)
        theirs = meetings(beams[b, :, 0], ANGLES, beams[a, ::2, 1:3], se2.inverse(T_ab), tolerance)
        met = np.concatenate([ours, theirs])
        assert row[3:].tolist() == [np.sum(met == 1), np.sum(met == -1)]
        assert row[:3] == pytest.approx(misfit(beams[a, :, 1:], beams[b, ::2, 1:], ANGLES, T_ab, 0.6, prior))


def test_only_what_two_scans_of_a_pass_saw_can_be_looked_through(twice: Recording) -> None:
    ranges = twice.ranges.copy()
    ranges[::2] = np.minimum(ranges[::2], 1.0)  # every second scan stands in a crowd
    config = SelfConsistencyConfig()
    pairs = compare(replace(twice, ranges=ranges), twice.dead_reckoning, config)
    assert np.nanmax(pairs.share[pairs.revisits]) == pytest.approx(0.0)
    assert np.nanmax(pairs.share[~pairs.revisits]) > 0.3
