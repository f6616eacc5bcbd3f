"""A submap is rigid: what it holds does not depend on where the map frame is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slam import se2
from slam.mapping.submap import cut
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

Record = Callable[..., Recording]

N = 12
ALL = np.arange(N)


def poses() -> Array:
    return np.column_stack([2.0 + 0.1 * np.arange(N), np.full(N, 2.5), 0.05 * np.arange(N)])


def test_in_the_frame_of_its_first_scan(room: Array, record: Record) -> None:
    recording = record(room, poses())
    scans = scans_of(recording)
    submap = cut(recording, scans, poses(), 3, 8, ALL)
    assert (submap.start, submap.stop) == (3, 8)
    np.testing.assert_array_equal(submap.anchor, poses()[3])
    assert len(submap.points) == sum(len(scan) for scan in scans[3:8])
    # The first scan is in its own frame; the last where the anchor sees it.
    np.testing.assert_allclose(submap.points.points[: len(scans[3])], scans[3].points, atol=1e-12)
    T = se2.between(poses()[3], poses()[7])
    np.testing.assert_allclose(
        submap.points.points[-len(scans[7]) :], scans[7].transformed(T).points, atol=1e-12
    )


def test_walls_are_where_they_are(room: Array, record: Record) -> None:
    recording = record(room, poses(), noise=0.0)
    submap = cut(recording, scans_of(recording), poses(), 2, 9, ALL)
    inside = se2.transform(submap.anchor, submap.points.points)
    a, b = room[:, :2], room[:, 2:]
    side = b - a
    share = np.einsum("nsk,sk->ns", inside[:, None] - a, side) / np.sum(side**2, axis=1)
    foot = a + np.clip(share, 0.0, 1.0)[..., None] * side
    apart = np.linalg.norm(inside[:, None] - foot, axis=-1).min(axis=1)
    # Points near a corner are drawn to the line of their neighbours, some of which are round it.
    assert np.max(apart) < 0.02
    assert np.mean(apart < 1e-6) > 0.9


def test_it_does_not_know_the_map_frame(room: Array, record: Record) -> None:
    recording = record(room, poses())
    scans = scans_of(recording)
    here = cut(recording, scans, poses(), 2, 9, ALL)
    T = np.array([30.0, -7.0, 2.0])
    there = cut(recording, scans, se2.compose(T, poses()), 2, 9, ALL)
    np.testing.assert_allclose(there.anchor, se2.compose(T, here.anchor))
    np.testing.assert_allclose(there.points.points, here.points.points, atol=1e-9)
    assert np.mean(there.grid.occupied != here.grid.occupied) < 1e-3


def test_only_trusted_scans_are_drawn(room: Array, record: Record) -> None:
    recording = record(room, poses())
    scans = scans_of(recording)
    trusted = np.array([0, 4, 6, 11])
    submap = cut(recording, scans, poses(), 3, 8, trusted)
    assert len(submap.points) == len(scans[4]) + len(scans[6])
    # The anchor stays that of the first scan, trusted or not.
    np.testing.assert_array_equal(submap.anchor, poses()[3])


def test_free_before_the_wall_and_occupied_at_it(room: Array, record: Record) -> None:
    recording = record(room, poses(), noise=0.0)
    grid = cut(recording, scans_of(recording), poses(), 0, N, ALL, resolution=0.1).grid
    assert grid.resolution == 0.1
    middle = se2.transform(se2.inverse(poses()[0]), [[4.5, 2.5], [8.0, 4.5], [9.0, 4.5]])
    cells = np.floor((middle - grid.origin) / grid.resolution).astype(int)
    (ahead, wall, _) = cells
    assert grid.free[ahead[1], ahead[0]]
    assert np.any(grid.occupied[wall[1] - 1 : wall[1] + 2, wall[0] - 1 : wall[0] + 2])
    x_min, x_max, *_ = grid.extent
    assert x_max < middle[2, 0] or not grid.free[cells[2][1], cells[2][0]]
    assert x_min < 0.0


def test_nothing_to_draw_is_an_error(room: Array, record: Record) -> None:
    recording = record(room, poses())
    with pytest.raises(ValueError, match=r"submap 3\.\.7: none of its scans may be drawn"):
        cut(recording, scans_of(recording), poses(), 3, 8, np.array([0, 1, 8]))
