"""What a scan is matched against: another scan, or a local map of the last ones.

The cells of the lattices cost or save time and change no result.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from slam.scan import Scan
from slam.se2 import Array

SCAN_CELL, MAP_CELL = 0.2, 0.1
"""Cells [m] of the lattice of a scan and of a local map, whose points are denser."""
SCAN_SIDE, MAP_SIDE = 64, 256
"""Buckets along a side of either lattice."""

Cloud = tuple[Array, Array, Array, Array]
"""Points (n, 2), normals (n, 2), covariance (n, 2, 2) and tangent_sigma (n,)."""


@dataclass(frozen=True)
class Reference:
    """A scan with the index that finds its points; build once, match many scans."""

    scan: Scan
    cell: float = SCAN_CELL
    """Cell [m] of the index."""
    side: int = SCAN_SIDE
    """Buckets along a side of the index, which repeats itself beyond."""

    def __len__(self) -> int:
        return len(self.scan)

    @property
    def points(self) -> Array:
        """Points ``(n, 2)`` m."""
        return self.scan.points

    @cached_property
    def cloud(self) -> Cloud:
        """The scan's arrays, contiguous for the kernels."""
        s = self.scan
        parts = (s.points, s.normals, s.covariance, s.tangent_sigma)
        return tuple(np.ascontiguousarray(part) for part in parts)  # type: ignore[return-value]

    @cached_property
    def indexed(self) -> tuple[Cloud, Any]:
        """The cloud and its lattice."""
        from slam.matching.neighbours import build

        return self.cloud, build(self.cloud[0], self.cell, self.side)

    @property
    def unindexed(self) -> tuple[Cloud, Any]:
        """The cloud and an empty lattice, for a scan whose points are not looked for."""
        from slam.matching.neighbours import empty

        return self.cloud, empty(0, SCAN_CELL, 1)


class LocalMap:
    """The last scans, each put where it was seen from, as one reference; the oldest makes room for the
    newest.

    A scan that comes or goes touches its own points only. Memory is that of ``most_scans`` scans.
    """

    def __init__(self, most_scans: int = 20) -> None:
        if most_scans < 1:
            raise ValueError(f"most_scans: expected 1 or more, got {most_scans}")
        self.most_scans = most_scans
        self._count = 0
        self._sizes = np.zeros(most_scans, dtype=np.int64)
        self._cloud, self._lattice = _allocate(most_scans, 0)

    def __len__(self) -> int:
        """Points in the map."""
        return int(self._sizes.sum())

    @property
    def points(self) -> Array:
        """Points ``(n, 2)`` m."""
        return self._cloud[0][np.isfinite(self._cloud[0][:, 0])]

    @property
    def indexed(self) -> tuple[Cloud, Any]:
        """The cloud, with rows of NaN where there is no point, and its lattice."""
        return self._cloud, self._lattice

    def add(self, scan: Scan, T_map_scan: Array) -> None:
        """Put a scan into the map at ``T_map_scan (3,)``."""
        from slam.matching.kernels import place
        from slam.matching.neighbours import insert, remove

        if len(scan) > self._rows:
            self._grow(len(scan))
        block = self._count % self.most_scans
        first = block * self._rows
        remove(self._cloud[0], self._lattice, first, first + self._sizes[block])
        self._cloud[0][first : first + self._sizes[block]] = np.nan
        place(Reference(scan).cloud, np.asarray(T_map_scan, dtype=np.float64), self._cloud, first)
        insert(self._cloud[0], self._lattice, first, first + len(scan))
        self._sizes[block] = len(scan)
        self._count += 1

    @property
    def _rows(self) -> int:
        return len(self._cloud[0]) // self.most_scans

    def _grow(self, rows: int) -> None:
        """More rows for each scan; happens when a scan has more points than all before."""
        from slam.matching.neighbours import insert

        old, before = self._cloud, self._rows
        self._cloud, self._lattice = _allocate(self.most_scans, rows)
        for block, size in enumerate(self._sizes):
            for part, whole in zip(old, self._cloud, strict=True):
                whole[block * rows : block * rows + size] = part[block * before : block * before + size]
            insert(self._cloud[0], self._lattice, block * rows, block * rows + size)


def _allocate(scans: int, rows: int) -> tuple[Cloud, Any]:
    """Empty cloud and lattice for scans of so many points."""
    from slam.matching.neighbours import empty

    n = scans * rows
    cloud = np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.full((n, 2, 2), np.nan), np.full(n, np.nan)
    return cloud, empty(n, MAP_CELL, MAP_SIDE)
