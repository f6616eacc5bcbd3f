"""Sparse Cholesky factor of symmetric matrices of 3 x 3 blocks: solve, and diagonal blocks of the inverse.

What it brings over a general sparse solver is in `slam.graph.gauss_newton`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from slam.se2 import Array


@dataclass(frozen=True)
class Structure:
    """Sparsity pattern of a K x K block matrix (3 x 3 blocks) and of its Cholesky factor.

    ``position (K,)`` is each node's place in the order of elimination; ``columns`` and ``by_row`` list the
    factor's blocks as `slam.graph.cholesky_kernels` takes them.
    """

    position: np.ndarray
    columns: tuple[np.ndarray, np.ndarray]
    by_row: tuple[np.ndarray, np.ndarray, np.ndarray]

    @classmethod
    def of(cls, pairs: np.ndarray, nodes: int) -> Structure:
        """Pattern of a matrix with off-diagonal blocks at ``pairs (P, 2)``, in minimum-degree order."""
        from slam.graph import cholesky_kernels as kernels

        position = _order(pairs, nodes)
        ends = np.sort(position[pairs], axis=1)
        key = np.unique((ends[:, 1] * nodes + ends[:, 0])[ends[:, 0] < ends[:, 1]])
        starts = np.searchsorted(key, nodes * np.arange(nodes + 1))
        parent = kernels.elimination_tree(starts, key % nodes)
        row_starts, row_columns = kernels.filled_rows(starts, key % nodes, parent)
        rows = np.repeat(np.arange(nodes), np.diff(row_starts))
        row_columns = row_columns[np.lexsort((row_columns, rows))]
        by_column = np.argsort(row_columns, kind="stable")
        starts = np.searchsorted(row_columns[by_column], np.arange(nodes + 1))
        row_places = np.empty_like(by_column)
        row_places[by_column] = np.arange(len(by_column))
        return cls(position, (starts, rows[by_column]), (row_starts, row_columns, row_places))

    @property
    def blocks(self) -> int:
        """Number of strictly lower blocks of the factor."""
        return len(self.columns[1])

    def block_index(self, pairs: np.ndarray) -> np.ndarray:
        """Index ``(P,)`` of the lower block of each pair ``(P, 2)`` of nodes; -1 - index for those that enter
        transposed."""
        i, j = self.position[pairs].T
        row_starts, row_columns, row_places = self.by_row
        nodes = len(self.position)
        keys = np.repeat(np.arange(nodes), np.diff(row_starts)) * nodes + row_columns
        key = np.maximum(i, j) * nodes + np.minimum(i, j)
        block = row_places[np.searchsorted(keys, key) % max(len(keys), 1)]
        return np.where(i > j, block, -1 - block)


@dataclass(frozen=True)
class Factor:
    """Cholesky factor of a matrix: blocks ``diagonal (K, 3, 3)`` in the order of elimination, ``lower (n, 3,
    3)`` in the order of `Structure.columns`."""

    structure: Structure
    diagonal: Array
    lower: Array

    @classmethod
    def of(cls, structure: Structure, diagonal: Array, lower: Array) -> Factor | None:
        """The factor of the matrix with blocks ``diagonal (K, 3, 3)`` and ``lower (n, 3, 3)``, in the order
        of the factor; None where it is not positive definite."""
        from slam.graph.cholesky_kernels import factorise

        diagonal, lower = diagonal.copy(), lower.copy()
        if not factorise(diagonal, lower, *structure.columns, *structure.by_row):
            return None
        return cls(structure, diagonal, lower)

    def solve(self, right: Array) -> Array:
        """Solution ``(K, 3, m)`` for right-hand sides of that shape, both in the nodes' own order."""
        from slam.graph.cholesky_kernels import solve

        x = np.empty_like(right)
        x[self.structure.position] = right
        solve(self.diagonal, self.lower, *self.structure.columns, x)
        return x[self.structure.position]

    def inverse_blocks(self) -> Array:
        """Diagonal blocks ``(K, 3, 3)`` of the inverse, in the nodes' own order."""
        from slam.graph.cholesky_kernels import inverse_blocks

        return inverse_blocks(self.diagonal, self.lower, *self.structure.columns)[self.structure.position]


def _order(pairs: np.ndarray, nodes: int) -> np.ndarray:
    """Place ``(K,)`` of every node in SuperLU's minimum-degree order of elimination."""
    i, j = pairs.T
    diagonal = np.arange(nodes)
    rows, columns = np.concatenate([i, j, diagonal]), np.concatenate([j, i, diagonal])
    ones = np.concatenate([np.full(2 * len(i), -1e-9), np.ones(nodes)])
    matrix = coo_array((ones, (rows, columns)), shape=(nodes, nodes)).tocsc()
    position: np.ndarray = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).perm_c
    return position.astype(np.int64)
