"""Sparse symmetric matrices of 3 x 3 blocks, one block row per pose: factor, solve, invert in part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from slam.se2 import Array


@dataclass(frozen=True)
class Structure:
    """Where a matrix of K x K blocks and its factor have some.

    ``position (K,)`` is each node's place in the order of elimination; ``columns`` and ``by_row`` list the
    factor's blocks as `slam.graph.cholesky_kernels` wants them.
    """

    position: np.ndarray
    columns: tuple[np.ndarray, np.ndarray]
    by_row: tuple[np.ndarray, np.ndarray, np.ndarray]

    @classmethod
    def of(cls, pairs: np.ndarray, nodes: int) -> Structure:
        """The structure of a matrix whose nodes ``pairs (P, 2)`` meet, eliminated by minimum degree."""
        from slam.graph import cholesky_kernels as kernels

        position = _order(pairs, nodes)
        ends = np.sort(position[pairs], axis=1)
        key = np.unique((ends[:, 1] * nodes + ends[:, 0])[ends[:, 0] < ends[:, 1]])
        starts = np.searchsorted(key, nodes * np.arange(nodes + 1))
        parent = kernels.elimination_tree(starts, key % nodes)
        row_starts, row_columns = kernels.filled_rows(starts, key % nodes, parent)
        for i in range(nodes):
            row_columns[row_starts[i] : row_starts[i + 1]].sort()
        *columns, places = kernels.by_columns(row_starts, row_columns)
        return cls(position, (columns[0], columns[1]), (row_starts, row_columns, places))

    @property
    def blocks(self) -> int:
        """How many strictly lower blocks the factor has."""
        return len(self.columns[1])

    def places(self, pairs: np.ndarray) -> np.ndarray:
        """Where the lower blocks of pairs ``(P, 2)`` of nodes lie; negative, less one, for those to be
        transposed."""
        i, j = self.position[pairs].T
        row_starts, row_columns, row_places = self.by_row
        nodes = len(self.position)
        keys = np.repeat(np.arange(nodes), np.diff(row_starts)) * nodes + row_columns
        found = row_places[
            np.searchsorted(keys, np.maximum(i, j) * nodes + np.minimum(i, j)) % max(len(keys), 1)
        ]
        return np.where(i > j, found, -1 - found)


@dataclass(frozen=True)
class Factor:
    """Cholesky factor of a matrix: ``diagonal (K, 3, 3)`` in the order of elimination, ``lower``."""

    structure: Structure
    diagonal: Array
    lower: Array

    @classmethod
    def of(cls, structure: Structure, diagonal: Array, lower: Array) -> Factor | None:
        """The factor of the matrix with these blocks; None where it is not positive definite."""
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
    """Place of every node in an order of elimination that fills in little, SuperLU's minimum degree."""
    i, j = pairs.T
    every = np.arange(nodes)
    rows, columns = np.concatenate([i, j, every]), np.concatenate([j, i, every])
    ones = np.concatenate([np.full(2 * len(i), -1e-9), np.ones(nodes)])
    matrix = coo_array((ones, (rows, columns)), shape=(nodes, nodes)).tocsc()
    position: np.ndarray = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).perm_c
    return position.astype(np.int64)
