"""What the pages and figures know of methods by their names, those of others among them."""

from __future__ import annotations

from collections.abc import Sequence

from scenarios.methods import METHODS


def is_told_the_truth(method: str) -> bool:
    """Whether a method does not compete."""
    return method in METHODS and METHODS[method].sees_truth


def merges_in_sequence(method: str) -> bool:
    """Whether a method aligns each submap to the map of all before it, in the frame of the first."""
    return method in METHODS and METHODS[method].in_sequence


def colour_indices(methods: Sequence[str]) -> list[int]:
    """The index of every method's colour; two more colours than the registry keeps are for others."""
    kept = {name: method.colour for name, method in METHODS.items() if method.colour is not None}
    others = [method for method in methods if method not in kept]
    return [kept[m] if m in kept else len(kept) + others.index(m) % 2 for m in methods]
