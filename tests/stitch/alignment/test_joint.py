"""Which rotations are tried."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.matching import Reference, match
from stitch import Prior
from stitch.align import AlignConfig
from stitch.alignment.joint import LATTICE_CELL, LATTICE_SIDE, paired_half_turns, rotations


def test_a_submaps_lattice_finds_the_same_as_a_scans(plan: dict[str, Any]) -> None:
    """Points over 40 m, on which the lattice of a scan repeats itself."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-20.0, 20.0, (3000, 2))
    some = plan["scan_of"](points[::7] + rng.normal(0.0, 0.01, (429, 2)))
    reference, guess = plan["scan_of"](points), np.array([0.05, -0.03, 0.001])
    found, expected = (
        match(of, some, guess, "icp", config=AlignConfig().refinement.matcher)
        for of in (Reference(reference, LATTICE_CELL, LATTICE_SIDE), reference)
    )
    np.testing.assert_array_equal(found.T_reference_scan, expected.T_reference_scan)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    assert found.n_matches > 300


def test_rotations_are_paired_with_their_half_turns() -> None:
    """Each is in one pair, also where the twin is the same angle beyond ±π."""
    assert paired_half_turns(np.array([0.1, 1.0, 0.1 - np.pi, -3.0])) == [[0.1, 0.1 - np.pi], [1.0], [-3.0]]
    assert paired_half_turns(np.array([3.0, 3.0 - np.pi, 3.0])) == [[3.0, 3.0 - np.pi], [3.0]]
    assert paired_half_turns(np.array([])) == []


def test_no_directions_means_a_sweep_around_the_prior() -> None:
    rng = np.random.default_rng(0)
    bushes = rng.normal(0.0, 5.0, (1500, 2))
    prior = Prior(np.array([0.0, 0.0, 3.1]), np.diag([1.0, 1.0, 0.06]) ** 2)
    found = se2.wrap(rotations(bushes, bushes[::-1], prior, AlignConfig()) - 3.1)
    swept = np.sort(found)
    assert np.all(np.diff(swept) <= 0.0351)
    assert swept[0] < -0.18
    assert swept[-1] > 0.18
    assert np.abs(swept).max() < 0.28


def test_without_directions_and_prior_the_whole_circle_is_searched() -> None:
    rng = np.random.default_rng(0)
    bushes = rng.normal(0.0, 5.0, (1500, 2))
    angles = np.sort(rotations(bushes, bushes[::-1], None, AlignConfig()))
    assert np.all(np.diff(angles) <= 0.0351)
    assert angles[0] == pytest.approx(-np.pi)
    assert angles[-1] > np.pi - 0.0351
    assert all(len(pair) == 2 for pair in paired_half_turns(angles))  # half of them need no drawing
