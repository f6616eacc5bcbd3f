"""The bundle over a drive that returns again and again: what makes the map, and where the rest is put."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.bench.matching.cost import LAP, round_and_round
from slam import se2
from slam.odometry.dead_reckoning import DeadReckoning
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array
from stitch.mapping.bundle import BundleConfig, adjust_all_scans

ROUNDS = 4
QUICK = BundleConfig(neighbours=6, per_pass=3, radii=(0.4, 0.25, 0.15, 0.15), passes=1)


def driven() -> tuple[Recording, Array]:
    """Rounds through a room, and poses of them that are some centimetres off."""
    rng = np.random.default_rng(0)
    recording = round_and_round(ROUNDS * LAP, rng)
    off = se2.exp(rng.normal(0.0, 1.0, (len(recording), 3)) * [0.03, 0.03, 0.01])
    off[0] = 0.0
    return recording, se2.compose(recording.dead_reckoning, off)


@pytest.fixture(scope="module")
def answers() -> dict[int, tuple[Array, Array]]:
    """Poses and covariances by how many rounds may make the map."""
    recording, poses = driven()
    scans, matched = scans_of(recording), np.ones(len(recording), dtype=bool)
    reckoning = DeadReckoning(recording)
    return {
        n: adjust_all_scans(reckoning, scans, poses, matched, replace(QUICK, passes=n)) for n in (1, ROUNDS)
    }


def test_those_placed_in_the_map_lie_as_if_all_had_made_it(answers: dict[int, tuple[Array, Array]]) -> None:
    recording, start = driven()
    by_one, by_all = answers[1][0], answers[ROUNDS][0]
    assert off(start, recording.dead_reckoning) > 0.03
    assert off(by_one, recording.dead_reckoning) < 0.015
    assert off(by_all, recording.dead_reckoning) < 0.015
    assert 0.0 < off(by_one, by_all) < 0.005


def test_they_are_known_no_better_than_the_map_they_lie_in(answers: dict[int, tuple[Array, Array]]) -> None:
    _, covariance = answers[1]
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    sigma = np.sqrt(np.trace(covariance[:, :2, :2], axis1=1, axis2=2))
    of_map, placed = sigma[:LAP], sigma[2 * LAP :]
    assert np.median(placed) > np.median(of_map)
    assert np.median(placed) < 3.0 * np.median(of_map)


def off(poses: Array, expected: Array) -> float:
    """Position error, median [m]."""
    return float(np.median(np.linalg.norm(poses[:, :2] - expected[:, :2], axis=1)))
