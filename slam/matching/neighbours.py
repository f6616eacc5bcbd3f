"""Nearest neighbours in the plane: points hung into the buckets of a square lattice that repeats itself.

A bucket serves all cells a multiple of the lattice's side apart, so that a lattice needs no bounds, is made
in a few microseconds, and points come and go without rebuilding it.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def empty(capacity, cell, side):
    """Lattice ``(cell, heads, following)`` of ``side × side`` buckets (a power of two) of ``cell`` m.

    It has room for ``capacity`` points and holds none; ``heads`` is the first row of each bucket,
    ``following`` the next row of each row, -1 for none.
    """
    return cell, np.full((side, side), -1, np.int32), np.full(capacity, -1, np.int32)


@njit(cache=True)
def _bucket(coordinate, cell, side):
    return int(np.floor(coordinate / cell)) & (side - 1)


@njit(cache=True)
def insert(points, lattice, start, stop):
    """Hang the rows ``start:stop`` of ``points (n, 2)`` m into the lattice."""
    cell, heads, following = lattice
    side = len(heads)
    for i in range(start, stop):
        row, column = _bucket(points[i, 1], cell, side), _bucket(points[i, 0], cell, side)
        following[i] = heads[row, column]
        heads[row, column] = i


@njit(cache=True)
def remove(points, lattice, start, stop):
    """Take the rows ``start:stop`` out again; they must be in the lattice, at the points they came with."""
    cell, heads, following = lattice
    side = len(heads)
    for i in range(start, stop):
        row, column = _bucket(points[i, 1], cell, side), _bucket(points[i, 0], cell, side)
        if heads[row, column] == i:
            heads[row, column] = following[i]
            continue
        before = heads[row, column]
        while following[before] != i:
            before = following[before]
        following[before] = following[i]


@njit(cache=True)
def build(points, cell, side):
    """Lattice of all ``points (n, 2)`` m."""
    lattice = empty(len(points), cell, side)
    insert(points, lattice, 0, len(points))
    return lattice


@njit(cache=True)
def nearest(points, lattice, x, y, radius, hint):
    """Row of the point nearest to ``(x, y)`` closer than ``radius`` m, or -1.

    ``hint`` is a row that may be near (-1 for none): the search then starts with its distance.
    """
    cell, heads, following = lattice
    side = len(heads)
    best, best_square = -1, radius * radius
    if hint >= 0:
        square = (points[hint, 0] - x) ** 2 + (points[hint, 1] - y) ** 2
        if square < best_square:
            best, best_square = hint, square
    reach = int(np.sqrt(best_square) / cell) + 1
    column, row = int(np.floor(x / cell)), int(np.floor(y / cell))
    low, high, left, right = row - reach, row + reach, column - reach, column + reach
    if 2 * reach + 1 > side:  # every bucket once
        reach = side
        low, high, left, right = row, row + side - 1, column, column + side - 1
    for ring in range(reach + 1):
        if ((ring - 1) * cell) ** 2 >= best_square and ring > 1 and reach < side:
            break
        for r in range(max(row - ring, low), min(row + ring, high) + 1):
            dy = max(r * cell - y, y - (r + 1) * cell, 0.0)
            if dy * dy >= best_square and reach < side:
                continue
            edge = r == row - ring or r == row + ring
            for c in range(column - ring, column + ring + 1, 1 if edge or ring == 0 else 2 * ring):
                if c < left or c > right:
                    continue
                dx = max(c * cell - x, x - (c + 1) * cell, 0.0)
                if dx * dx + dy * dy >= best_square and reach < side:
                    continue
                i = heads[r & (side - 1), c & (side - 1)]
                while i >= 0:
                    square = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                    if square < best_square:
                        best, best_square = i, square
                    i = following[i]
    return best


@njit(cache=True)
def nearest_all(points, lattice, queries, radius):
    """Row of the point nearest to each of ``queries (m, 2)`` closer than ``radius`` m, -1 for none."""
    rows = np.empty(len(queries), np.int64)
    for i in range(len(queries)):
        rows[i] = nearest(points, lattice, queries[i, 0], queries[i, 1], radius, -1)
    return rows
