"""Every scenario on arrival, and the hospital in particular."""

from __future__ import annotations

import importlib
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from scenarios.catalogue import CATALOGUE

BEGINNING = 30.0
"""Seconds of a drive that every scenario is tried with."""


@cache
def built(name, seed):
    return CATALOGUE[name].build(np.random.default_rng(seed))


def outer_size(setup):
    """Extent of what stands in the world [m]."""
    corners = np.vstack([prism.footprint for prism in setup.world.prisms])
    return np.ptp(corners, axis=0)


@pytest.fixture(scope="module")
def hospital():
    from sim.record import simulate

    return simulate(CATALOGUE["hospital"], 100)


def test_listing_imports_no_simulator():
    code = (
        "import sys; from scenarios.catalogue import CATALOGUE; list(CATALOGUE.values());"
        "sys.exit(any(m in sys.modules for m in ('numpy', 'numba', 'pymunk', 'sim')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_scenario_is_described_and_another_seed_builds_another(name):
    scenario = CATALOGUE[name]
    assert scenario.name == name
    assert scenario.summary.endswith(".")
    assert "\n" not in scenario.summary
    a, b = built(name, 1), built(name, 2)
    assert not np.array_equal(a.waypoints, b.waypoints)
    assert not np.array_equal(a.world.terrain.heights, b.world.terrain.heights)


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_scenario_says_in_its_file_why_it_exists(name):
    module = importlib.import_module(f"scenarios.catalogue.{name}")
    assert len(module.__doc__.split()) > 40


@pytest.mark.parametrize("name", CATALOGUE)
def test_seeds_leave_the_size_of_a_scenario_alone(name):
    """And the size is what the list says."""
    sizes = np.array([outer_size(built(name, seed)) for seed in (1, 2)])
    np.testing.assert_allclose(sizes[0], sizes[1], atol=0.02 * sizes.max())
    np.testing.assert_allclose(sizes[0], CATALOGUE[name].size_m, atol=0.5)


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_route_of_every_scenario_is_as_long_as_the_list_says(name):
    route = built(name, 1).waypoints
    length = np.hypot(*np.diff(route, axis=0).T).sum()
    assert length == pytest.approx(CATALOGUE[name].drive_m, rel=0.25)


@pytest.mark.parametrize("name", ["beehive", "corridor"])
def test_a_whole_drive_is_completed_and_as_long_as_the_list_says(name):
    from sim.record import simulate

    run = simulate(CATALOGUE[name], 100)
    assert run.ending == "completed"
    assert run.recording.distance == pytest.approx(CATALOGUE[name].drive_m, rel=0.25)
    assert 600 <= len(run.recording) <= 1500


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_scenario_drives_and_sees_and_does_so_again(name, begun):
    """It starts free of obstacles, gets on along its route, sees something; the seed decides every byte, of
    the world as of the drive."""
    from sim.driver import resample
    from sim.record import simulate

    run, again = (simulate(begun(name, BEGINNING), 100) for _ in range(2))
    recording = run.recording
    assert run.ending == "out of time"
    assert recording.name == name
    assert recording.time[-1] == pytest.approx(BEGINNING, abs=1.0)
    assert recording.distance > 5.0
    path = resample(run.setup.waypoints)
    off = np.hypot(*(recording.truth[:, None, :2] - path[None]).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.8
    assert np.median(np.isfinite(recording.ranges).sum(axis=1)) > 0.25 * recording.ranges.shape[1]
    for field in ("time", "ranges", "dead_reckoning", "truth"):
        assert getattr(recording, field).tobytes() == getattr(again.recording, field).tobytes()
    one, other = run.setup, again.setup
    np.testing.assert_array_equal(one.waypoints, other.waypoints)
    np.testing.assert_array_equal(one.world.obstacles.edges, other.world.obstacles.edges)
    np.testing.assert_array_equal(one.world.terrain.heights, other.world.terrain.heights)


def test_the_beehive_has_walls_in_three_directions():
    setup = built("beehive", 1)
    walls = np.vstack([p.edges for p in setup.world.prisms if p.kind == "wall"])
    along = walls[:, 2:] - walls[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    angle = np.rad2deg(np.arctan2(along[:, 1], along[:, 0])) % 180.0
    histogram, _ = np.histogram(angle, np.arange(-1.0, 182.0, 2.0), weights=length)
    histogram[0] += histogram[-1]
    peaks = 2.0 * np.sort(np.argsort(histogram[:-1])[-3:])
    np.testing.assert_array_equal(np.diff(peaks), [60.0, 60.0])


def test_twin_rooms_are_identical_to_the_last_piece_of_furniture():
    from scenarios.catalogue.twin_rooms import DEPTH, ROOMS, WIDTH

    setup = built("twin_rooms", 1)
    pieces = [p for p in setup.world.prisms if p.kind == "furniture"]
    inside = [
        sorted(
            tuple(np.round((p.footprint.mean(axis=0) - [WIDTH * k, 0.0]), 9))
            for p in pieces
            if WIDTH * k < p.footprint[0, 0] < WIDTH * (k + 1) and p.footprint[0, 1] < DEPTH
        )
        for k in range(ROOMS)
    ]
    assert len(inside[0]) >= 6
    for room in inside[1:]:
        np.testing.assert_allclose(room, inside[0], atol=1e-6)


def test_the_corridor_shows_its_length_nowhere_between_the_halls():
    """Three places along it see the same."""
    from scenarios.catalogue.corridor import HALL, LENGTH
    from sim.laser import Raycaster

    setup = built("corridor", 1)
    places = [[HALL + share * LENGTH, 0.5 * HALL, 0.0] for share in (0.25, 0.5, 0.75)]
    a, b, c = Raycaster(setup.world).cast(places, setup.scanner.angles, setup.scanner.range_max)
    np.testing.assert_allclose(a, b, atol=1e-9)
    np.testing.assert_allclose(a, c, atol=1e-9)


def test_smoke_blinds_the_laser_between_the_two_drives_and_nowhere_else_for_as_long():
    from scenarios.catalogue import two_drives
    from sim.record import simulate

    @dataclass(frozen=True)
    class OnlyTheStore:
        """The end of the first drive, the store, and the beginning of the second."""

        name: str = "two_drives"

        def build(self, rng):
            setup = CATALOGUE["two_drives"].build(rng)
            store = two_drives.STORE
            x, y = setup.waypoints.T
            within = (x > store.x0) & (x < store.x1) & (y > store.y0) & (y < store.y1)
            first, last = np.flatnonzero(within)[[0, -1]]
            route = setup.waypoints[first - 1 : last + 3]
            begin = (*route[0], -np.pi / 2.0)
            return replace(setup, start=begin, waypoints=route)

    run = simulate(OnlyTheStore(), 100)
    assert run.ending == "completed"
    blind = np.isfinite(run.recording.ranges).sum(axis=1) < 10
    assert 30 < blind.sum() < 120
    assert not blind[:3].any()
    assert not blind[-3:].any()
    error = run.recording.dead_reckoning[:, 2] - run.recording.truth[:, 2]
    jump = np.rad2deg(np.abs(np.diff(np.unwrap(error))).max())
    assert jump > 8.0  # the fall, while blind


@pytest.mark.parametrize("seed", range(100, 104))
def test_the_hospital_has_rooms_low_furniture_and_a_free_route(seed):
    from scenarios.catalogue.hospital import CLEARANCE, draw_rooms
    from sim.driver import resample

    rooms = draw_rooms(np.random.default_rng(seed)).all
    assert len(rooms) >= 10
    assert all(room.doors for room in rooms)
    setup = CATALOGUE["hospital"].build(np.random.default_rng(seed))
    furniture = [p for p in setup.world.prisms if p.kind == "furniture"]
    assert len(furniture) > 50
    assert {p.kind for p in setup.world.prisms} == {"wall", "furniture"}
    assert all(p.z_hi < 2.5 for p in furniture)
    assert sum(p.z_lo > setup.scanner.height for p in furniture) >= 10  # seen only by a tilted laser
    path = resample(setup.waypoints)
    for p in furniture:
        corners = np.hypot(*(p.footprint[:, None] - path[None]).transpose(2, 0, 1))
        assert corners.min() >= CLEARANCE - 0.06


def test_a_hospital_drive(hospital):
    recording = hospital.recording
    assert recording.name == "hospital"
    assert hospital.ending == "completed"
    assert 1100 <= len(recording) <= 2000
    assert 100.0 <= recording.distance <= 220.0
    np.testing.assert_array_equal(recording.laser.T_robot_laser, [-0.08, 0.0, 0.0])
    assert recording.laser.range_max == 4.0


def test_the_hospital_tilts_the_robot_now_and_then(hospital):
    tilted = np.abs(hospital.tilt).max(axis=1) > np.deg2rad(5.0)
    assert 0.03 < tilted.mean() < 0.12
    assert np.median(np.abs(hospital.tilt)) < np.deg2rad(0.5)


def test_the_hospital_route_revisits_places(hospital):
    """Many poses come within a metre of one that lies 20 m of driving or more back."""
    truth = hospital.recording.truth
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    near = np.hypot(*(truth[:, None, :2] - truth[None, :, :2]).transpose(2, 0, 1)) < 1.0
    revisited = (near & (along[:, None] - along[None] > 20.0)).any(axis=1)
    assert revisited.mean() > 0.15


def test_the_hospital_ins_is_good_in_position_and_poor_in_yaw(hospital):
    error = hospital.recording.dead_reckoning - hospital.recording.truth
    assert 0.05 < np.hypot(error[:, 0], error[:, 1]).max() < 0.8
    yaw = np.rad2deg(np.unwrap(error[:, 2]))
    assert 8.0 < np.abs(yaw - yaw[0]).max() < 30.0
    assert np.abs(np.diff(yaw)).max() > 8.0  # the shock of the fall


def test_the_hospital_has_a_hall_too_wide_for_its_laser(hospital):
    seen = np.isfinite(hospital.recording.ranges).sum(axis=1)
    assert 5 < (seen < 10).sum() < 60
    assert np.median(seen) > 150


def test_the_report_s_matcher_loses_its_place_in_the_hospital(hospital):
    """Between 2 and 15 % of the steps that ManifoldSLAM tries have no match at all."""
    from slam.odometry.tracker import MANIFOLD_SLAM, track

    trace = track(hospital.recording, MANIFOLD_SLAM).confidence["trace2"]
    assert 0.02 < np.isinf(trace).sum() / (~np.isnan(trace)).sum() < 0.15
