"""Sparse Cholesky factor of symmetric matrices of 3 x 3 blocks: solve, and diagonal blocks of the inverse
(Davis, Direct Methods for Sparse Linear Systems, 2006).

In the kernels nodes are numbered in the order of elimination. The factor's strictly lower blocks lie column
by column: those of column k in ``starts[k]:starts[k + 1]``, their rows ascending in ``rows``. Row by row they
are listed in ``row_starts``, ``row_columns`` (ascending) and ``row_places`` (where in the columns).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from slam.se2 import Array


@dataclass(frozen=True)
class Structure:
    """Sparsity pattern of a K x K block matrix (3 x 3 blocks) and of its Cholesky factor.

    ``position (K,)`` is each node's place in the order of elimination; ``columns`` and ``by_row`` list the
    factor's blocks as the kernels take them.
    """

    position: np.ndarray
    columns: tuple[np.ndarray, np.ndarray]
    by_row: tuple[np.ndarray, np.ndarray, np.ndarray]

    @classmethod
    def of(cls, pairs: np.ndarray, nodes: int) -> Structure:
        """Pattern of a matrix with off-diagonal blocks at ``pairs (P, 2)``, in minimum-degree order."""
        position = _order(pairs, nodes)
        ends = np.sort(position[pairs], axis=1)
        key = np.unique((ends[:, 1] * nodes + ends[:, 0])[ends[:, 0] < ends[:, 1]])
        starts = np.searchsorted(key, nodes * np.arange(nodes + 1))
        parent = elimination_tree(starts, key % nodes)
        row_starts, row_columns = filled_rows(starts, key % nodes, parent)
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
        diagonal, lower = diagonal.copy(), lower.copy()
        if not factorise(diagonal, lower, *structure.columns, *structure.by_row):
            return None
        return cls(structure, diagonal, lower)

    def solve(self, right: Array) -> Array:
        """Solution ``(K, 3, m)`` for right-hand sides of that shape, both in the nodes' own order."""
        x = np.empty_like(right)
        x[self.structure.position] = right
        solve(self.diagonal, self.lower, *self.structure.columns, x)
        return x[self.structure.position]

    def inverse_blocks(self) -> Array:
        """Diagonal blocks ``(K, 3, 3)`` of the inverse, in the nodes' own order."""
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


@njit(cache=True)
def elimination_tree(starts: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Elimination tree: parent ``(K,)`` of every node, -1 for roots (Liu 1990).

    ``columns[starts[i]:starts[i + 1]]`` are the columns of row i left of its diagonal.
    """
    n = len(starts) - 1
    parent, ancestor = np.full(n, -1), np.full(n, -1)
    for i in range(n):
        for q in range(starts[i], starts[i + 1]):
            k = columns[q]
            while k != -1 and k < i:
                following = ancestor[k]
                ancestor[k] = i
                if following == -1:
                    parent[k] = i
                k = following
    return parent


@njit(cache=True)
def filled_rows(starts: np.ndarray, columns: np.ndarray, parent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Column indices of every row of L, unsorted, as CSR: the row subtrees of the elimination tree
    (Davis 2006, ch. 4)."""
    n = len(starts) - 1
    row_starts, seen = np.zeros(n + 1, dtype=np.int64), np.full(n, -1)
    for count in (True, False):
        if not count:
            row_columns = np.empty(row_starts[n], dtype=np.int64)
            seen[:] = -1
        for i in range(n):
            size, seen[i] = 0, i
            for q in range(starts[i], starts[i + 1]):
                k = columns[q]
                while seen[k] != i:
                    seen[k] = i
                    if not count:
                        row_columns[row_starts[i] + size] = k
                    size += 1
                    k = parent[k]
            if count:
                row_starts[i + 1] = row_starts[i] + size
    return row_starts, row_columns


@njit(cache=True)
def _subtract(out: Array, a: Array, b: Array) -> None:
    """``out -= a bᵀ``."""
    for r in range(3):
        for c in range(3):
            out[r, c] -= a[r, 0] * b[c, 0] + a[r, 1] * b[c, 1] + a[r, 2] * b[c, 2]


@njit(cache=True)
def _subtract_column(lower: Array, where: np.ndarray, rows: np.ndarray, first: int, stop: int) -> None:
    """Cholesky column update: with L[j, k] the block at ``first``, subtract L[r, k] L[j, k]ᵀ from L[r, j] for
    every later row r of column k. Unrolled by hand: the hot loop."""
    a, b, c = lower[first, 0, 0], lower[first, 0, 1], lower[first, 0, 2]
    d, e, f = lower[first, 1, 0], lower[first, 1, 1], lower[first, 1, 2]
    g, h, i = lower[first, 2, 0], lower[first, 2, 1], lower[first, 2, 2]
    for p in range(first + 1, stop):
        out = where[rows[p]]
        for r in range(3):
            x, y, z = lower[p, r, 0], lower[p, r, 1], lower[p, r, 2]
            lower[out, r, 0] -= x * a + y * b + z * c
            lower[out, r, 1] -= x * d + y * e + z * f
            lower[out, r, 2] -= x * g + y * h + z * i


@njit(cache=True)
def _root(block: Array) -> bool:
    """Lower Cholesky factor of a 3 x 3 block in its place; False where it is not positive definite."""
    for c in range(3):
        for k in range(c):
            block[c, c] -= block[c, k] ** 2
        if not block[c, c] > 0.0:
            return False
        block[c, c] = np.sqrt(block[c, c])
        for r in range(c + 1, 3):
            for k in range(c):
                block[r, c] -= block[r, k] * block[c, k]
            block[r, c] /= block[c, c]
            block[c, r] = 0.0
    return True


@njit(cache=True)
def _forward(root: Array, x: Array) -> None:
    """``x = root⁻¹ x`` for a lower triangular 3 x 3 root and ``x (3, m)``."""
    for m in range(x.shape[1]):
        x[0, m] /= root[0, 0]
        x[1, m] = (x[1, m] - root[1, 0] * x[0, m]) / root[1, 1]
        x[2, m] = (x[2, m] - root[2, 0] * x[0, m] - root[2, 1] * x[1, m]) / root[2, 2]


@njit(cache=True)
def _backward(root: Array, x: Array) -> None:
    """``x = root⁻ᵀ x``."""
    for m in range(x.shape[1]):
        x[2, m] /= root[2, 2]
        x[1, m] = (x[1, m] - root[2, 1] * x[2, m]) / root[1, 1]
        x[0, m] = (x[0, m] - root[1, 0] * x[1, m] - root[2, 0] * x[2, m]) / root[0, 0]


@njit(cache=True)
def factorise(diagonal: Array, lower: Array, starts: np.ndarray, rows: np.ndarray, row_starts: np.ndarray,
              row_columns: np.ndarray, row_places: np.ndarray) -> bool:  # fmt: skip
    """Factor a matrix with blocks ``diagonal (K, 3, 3)`` and ``lower (n, 3, 3)`` in place, left-looking.

    False where the matrix is not positive definite.
    """
    where = np.empty(len(diagonal), dtype=np.int64)
    for j in range(len(diagonal)):
        for p in range(starts[j], starts[j + 1]):
            where[rows[p]] = p
        for q in range(row_starts[j], row_starts[j + 1]):
            k, first = row_columns[q], row_places[q]
            _subtract(diagonal[j], lower[first], lower[first])
            _subtract_column(lower, where, rows, first, starts[k + 1])
        if not _root(diagonal[j]):
            return False
        for p in range(starts[j], starts[j + 1]):
            _forward(diagonal[j], lower[p].T)
    return True


@njit(cache=True)
def solve(diagonal: Array, lower: Array, starts: np.ndarray, rows: np.ndarray, x: Array) -> None:
    """Solve the factored equations for right-hand sides ``x (K, 3, m)`` in place."""
    n = len(diagonal)
    for j in range(n):
        _forward(diagonal[j], x[j])
        for p in range(starts[j], starts[j + 1]):
            for m in range(x.shape[2]):
                for r in range(3):
                    for c in range(3):
                        x[rows[p], r, m] -= lower[p, r, c] * x[j, c, m]
    for j in range(n - 1, -1, -1):
        for p in range(starts[j], starts[j + 1]):
            for m in range(x.shape[2]):
                for r in range(3):
                    for c in range(3):
                        x[j, c, m] -= lower[p, r, c] * x[rows[p], r, m]
        _backward(diagonal[j], x[j])


@njit(cache=True)
def inverse_blocks(diagonal: Array, lower: Array, starts: np.ndarray, rows: np.ndarray) -> Array:
    """Diagonal blocks ``(K, 3, 3)`` of the inverse of a factored matrix (Takahashi, Fagan & Chen 1973).

    From the last column to the first; only blocks of the inverse within the factor's pattern are needed.
    """
    n = len(diagonal)
    Z, Z_lower, where = np.empty((n, 3, 3)), np.zeros(lower.shape), np.full(n, -1)
    for j in range(n - 1, -1, -1):
        root = np.eye(3)
        _forward(diagonal[j], root)
        first, last = starts[j], starts[j + 1]
        unit = np.empty((last - first, 3, 3))
        for p in range(first, last):
            where[rows[p]] = p
            unit[p - first] = lower[p] @ root
        for p in range(first, last):
            k = rows[p]
            _subtract(Z_lower[p], Z[k], unit[p - first].T)
            for q in range(starts[k], starts[k + 1]):
                other = where[rows[q]]
                if other >= 0:
                    _subtract(Z_lower[other], Z_lower[q], unit[p - first].T)
                    _subtract(Z_lower[p], Z_lower[q].T, unit[other - first].T)
        Z[j] = root.T @ root
        for p in range(first, last):
            _subtract(Z[j], unit[p - first].T, Z_lower[p].T)
            where[rows[p]] = -1
    return Z
