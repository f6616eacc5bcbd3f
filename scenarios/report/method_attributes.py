"""What the pages and figures know of methods by their names."""

from __future__ import annotations

from collections.abc import Sequence

COLOURS = ("slamstitch", "ins", "wsm", "htms", "icp", "oracle")
"""Methods that keep their colour on every page; two more colours are for others."""
BASELINE = "ins"
"""Dead reckoning, which the others are compared with."""
SEES_TRUTH = "oracle"
"""The method that does not compete."""
OURS = "slamstitch"
MERGING = ("htms",)
"""Methods that align each submap to the map of all before it, in the frame of the first."""


def colour_indices(methods: Sequence[str]) -> list[int]:
    """The index of every method's colour."""
    others = [method for method in methods if method not in COLOURS]
    return [
        COLOURS.index(method) if method in COLOURS else len(COLOURS) + others.index(method) % 2
        for method in methods
    ]
