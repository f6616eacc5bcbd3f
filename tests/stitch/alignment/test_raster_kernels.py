"""Kernels of rasters against numpy."""

from __future__ import annotations

import numpy as np

from slam import se2
from stitch.alignment.raster_kernels import cells_of, look_up


def test_cells_are_those_of_numpy() -> None:
    """Points beside the lattice go to its border."""
    points, T, first = (
        np.random.default_rng(1).uniform(-3.0, 3.0, (200, 2)),
        np.array([0.3, -0.2, 0.7]),
        [-4, -3],
    )
    column, row = (np.floor(se2.transform(T, points) / 0.5) - first).astype(int).T
    assert column.min() < 0
    assert row.max() >= 6
    expected = np.clip(row, 0, 5) * 7 + np.clip(column, 0, 6)
    np.testing.assert_array_equal(cells_of(points, T, np.array(first, dtype=float), (6, 7), 0.5), expected)


def test_cells_looked_up_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    cells, origin, T, first = (
        rng.uniform(size=(9, 12)) < 0.5,
        np.array([-1.1, 0.4]),
        np.array([0.2, 0.1, 0.5]),
        [-5, -2],
    )
    row, column = np.indices((16, 20))
    centres = (np.stack([column, row], -1).reshape(-1, 2) + first + 0.5) * 0.2
    j, i = np.floor((se2.transform(se2.inverse(T), centres) - origin) / 0.3).astype(int).T
    within = (i >= 0) & (i < 9) & (j >= 0) & (j < 12)
    expected = within & cells[np.clip(i, 0, 8), np.clip(j, 0, 11)]
    found = look_up(cells, origin, 0.3, T, np.array(first, dtype=float), (16, 20), 0.2)
    np.testing.assert_array_equal(found, expected.reshape(16, 20))
    assert expected.any()
    assert not within.all()
