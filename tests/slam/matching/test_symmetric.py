"""Eigenvectors of symmetric 3×3 matrices against LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest

from slam.matching.symmetric import eigh3
from slam.se2 import Array


def assert_decomposed(matrix: Array) -> None:
    values, vectors = eigh3(matrix)
    scale = max(np.abs(matrix).max(), 1e-300)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-13 * scale)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-13)
    np.testing.assert_allclose((vectors * values) @ vectors.T, matrix, atol=1e-13 * scale)


def test_twin() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 3, 3)
        assert_decomposed(0.5 * (root + root.T))
        assert_decomposed(root @ root.T)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.eye(3), np.diag([3.0, 1.0, 2.0]), np.ones((3, 3)), -np.diag([1.0, 1.0, 5.0])],
)
def test_repeated_and_ordered_eigenvalues(matrix: Array) -> None:
    assert_decomposed(matrix)
