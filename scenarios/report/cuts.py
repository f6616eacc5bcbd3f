"""Where a method cut the drive."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from slam.mapping.submap import Submap


def cuts(submaps: Sequence[Submap]) -> list[tuple[int, int]]:
    """First and last scan of every stretch that belongs to no submap.

    Where two submaps touch, the drive was divided but not cut.
    """
    return [(a.stop, b.start - 1) for a, b in pairwise(submaps) if a.stop < b.start]
