"""Every scenario on arrival, and the hospital in particular."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from scenarios.catalogue import CATALOGUE


@pytest.fixture(scope="module")
def hospital():
    from sim.record import simulate

    return simulate(CATALOGUE["hospital"], 100)


def test_listing_imports_no_simulator():
    code = (
        "import sys; from scenarios.catalogue import CATALOGUE; list(CATALOGUE.values());"
        "sys.exit(any(m in sys.modules for m in ('numba', 'pymunk', 'sim')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_scenario_is_described_and_builds_alike_from_alike_seeds(name):
    scenario = CATALOGUE[name]
    assert scenario.name == name
    assert scenario.summary.endswith(".")
    assert "\n" not in scenario.summary
    a, b, c = (scenario.build(np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.waypoints, b.waypoints)
    np.testing.assert_array_equal(a.world.obstacles.edges, b.world.obstacles.edges)
    np.testing.assert_array_equal(a.world.terrain.heights, b.world.terrain.heights)
    assert not np.array_equal(a.waypoints, c.waypoints)
    assert not np.array_equal(a.world.terrain.heights, c.world.terrain.heights)


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
    from slam.frontend import MANIFOLD_SLAM, track

    trace = track(hospital.recording, MANIFOLD_SLAM).confidence["trace2"]
    assert 0.02 < np.isinf(trace).sum() / (~np.isnan(trace)).sum() < 0.15
