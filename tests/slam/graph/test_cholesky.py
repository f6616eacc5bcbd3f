"""The sparse factor of 3 x 3 blocks against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.graph.cholesky import Factor, Structure
from slam.se2 import Array


def matrix(nodes: int, pairs: np.ndarray, seed: int) -> tuple[Structure, Array, Array, Array]:
    """A structure, the blocks that it wants of a positive definite matrix, and that matrix dense."""
    rng = np.random.default_rng(seed)
    structure = Structure.of(pairs, nodes)
    whole: Array = np.zeros((nodes, 3, nodes, 3))
    lower: Array = np.zeros((structure.blocks, 3, 3))
    for (i, j), at in zip(pairs, structure.block_index(pairs), strict=True):
        block = rng.normal(size=(3, 3))
        whole[i, :, j] += block
        whole[j, :, i] += block.T
        lower[at if at >= 0 else -1 - at] += block if at >= 0 else block.T
    own = 10.0 * (1 + len(pairs)) * np.eye(3) + rng.uniform(0.0, 1.0, (nodes, 1, 1))
    whole[np.arange(nodes), :, np.arange(nodes)] += own
    return structure, own[np.argsort(structure.position)], lower, whole.reshape(3 * nodes, 3 * nodes)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 14), st.integers(0, 30), st.integers(0, 1000))
def test_it_solves_and_inverts_what_dense_algebra_does(nodes: int, count: int, seed: int) -> None:
    pairs = np.random.default_rng(seed).integers(0, nodes, (count, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    structure, diagonal, lower, dense = matrix(nodes, pairs, seed)
    factor = Factor.of(structure, diagonal, lower)
    assert factor is not None
    right = np.random.default_rng(seed + 1).normal(size=(nodes, 3, 2))
    expected = np.linalg.solve(dense, right.reshape(-1, 2)).reshape(nodes, 3, 2)
    np.testing.assert_allclose(factor.solve(right), expected, atol=1e-10)
    inverse = np.linalg.inv(dense).reshape(nodes, 3, nodes, 3)
    blocks = inverse[np.arange(nodes), :, np.arange(nodes)]
    np.testing.assert_allclose(factor.inverse_blocks(), blocks, atol=1e-10)


def test_a_long_chain_with_a_loop_fills_in_little() -> None:
    """Of a loop of n nodes a good order leaves fewer than 2 n lower blocks; a bad one has n² / 2."""
    n = 200
    k = np.arange(n)
    structure = Structure.of(np.stack([k, (k + 1) % n], -1), n)
    assert n <= structure.blocks < 2 * n


@pytest.mark.parametrize("bad", [-1.0, 0.0, np.nan])
def test_what_is_not_positive_definite_has_no_factor(bad: float) -> None:
    structure, diagonal, lower, _ = matrix(4, np.array([[0, 1], [2, 3], [0, 3]]), 0)
    diagonal[2] = bad * np.eye(3)
    assert Factor.of(structure, diagonal, lower) is None


def test_the_matrix_given_is_left_as_it_was() -> None:
    structure, diagonal, lower, _ = matrix(4, np.array([[0, 1], [2, 3], [0, 3]]), 0)
    before = diagonal.copy(), lower.copy()
    Factor.of(structure, diagonal, lower)
    np.testing.assert_array_equal(diagonal, before[0])
    np.testing.assert_array_equal(lower, before[1])
