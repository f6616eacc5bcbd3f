"""The local map: scans come and go, and it answers as if it had been built afresh each time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slam import se2
from slam.matching import LocalMap, Match, NoMatch, Reference, match
from slam.matching.neighbours import nearest
from slam.scan import Scan
from slam.se2 import Array

Look = Callable[..., Scan]
POSES = np.array([[1.5 + 0.4 * k, 2.5, 0.1 * k] for k in range(7)])


@pytest.fixture(scope="module")
def scans(room: Array, look: Look) -> list[Scan]:
    rng = np.random.default_rng(0)
    return [look(room, pose, rng) for pose in POSES]


def test_it_holds_the_last_scans_where_they_were_seen(scans: list[Scan]) -> None:
    local = LocalMap(most_scans=3)
    for k, (scan, pose) in enumerate(zip(scans, POSES, strict=True)):
        local.add(scan, pose)
        held = [s.transformed(p) for s, p in zip(scans[: k + 1], POSES[: k + 1], strict=True)][-3:]
        expected = Scan.merged(held)
        cloud, lattice = local.indexed
        assert len(local) == len(expected) == np.isfinite(cloud[0][:, 0]).sum()
        order, rows = np.lexsort(expected.points.T), np.flatnonzero(np.isfinite(cloud[0][:, 0]))
        rows = rows[np.lexsort(cloud[0][rows].T)]
        for part, whole in zip(("points", "normals", "covariance", "tangent_sigma"), cloud, strict=True):
            np.testing.assert_allclose(whole[rows], getattr(expected, part)[order], atol=1e-12)
        for x, y in expected.points[::17] + 0.03:
            row = nearest(cloud[0], lattice, x, y, 0.5, -1)
            apart = np.hypot(*(expected.points - [x, y]).T).min()
            assert np.hypot(*(cloud[0][row] - [x, y])) == pytest.approx(apart, abs=1e-12)


def test_matching_against_it_is_matching_against_all_its_points(scans: list[Scan]) -> None:
    local = LocalMap(most_scans=4)
    for scan, pose in zip(scans[:6], POSES[:6], strict=True):
        local.add(scan, pose)
    merged = Scan.merged([s.transformed(p) for s, p in zip(scans[2:6], POSES[2:6], strict=True)])
    guess = POSES[6] + [0.05, -0.04, 0.03]
    here, there = match(local, scans[6], guess), match(Reference(merged), scans[6], guess)
    assert isinstance(here, Match)
    assert isinstance(there, Match)
    np.testing.assert_allclose(here.T_reference_scan, there.T_reference_scan, atol=1e-6)
    np.testing.assert_allclose(here.covariance, there.covariance, rtol=1e-3)
    np.testing.assert_allclose(se2.between(here.T_reference_scan, POSES[6]), 0.0, atol=0.01)


def test_memory_is_that_of_its_scans(scans: list[Scan]) -> None:
    local = LocalMap(most_scans=2)
    few = scans[0].selected(np.arange(20))
    local.add(few, POSES[0])
    local.add(scans[1], POSES[1])  # more points than before
    assert len(local) == 20 + len(scans[1])
    sizes = set()
    for _ in range(50):
        local.add(scans[1], POSES[1])
        sizes.add(len(local.indexed[0][0]))
    assert sizes == {2 * len(scans[1])}


def test_nothing_to_match(scans: list[Scan]) -> None:
    assert match(LocalMap(), scans[0], np.zeros(3)) == NoMatch("a scan has no points")
    blind = scans[0].selected(np.zeros(len(scans[0]), dtype=bool))
    local = LocalMap(most_scans=2)
    local.add(blind, POSES[0])
    assert len(local) == 0
    with pytest.raises(ValueError, match=r"^most_scans: expected"):
        LocalMap(most_scans=0)
