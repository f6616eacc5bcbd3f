"""Work that is spread over processes comes back in its order."""

from __future__ import annotations

from scenarios.ablate.workers import in_order


def _square(k: int) -> int:
    return k * k


def test_work_is_returned_in_order() -> None:
    assert list(in_order(_square, range(5), 1)) == [0, 1, 4, 9, 16]
    assert list(in_order(_square, range(5), 2)) == [0, 1, 4, 9, 16]
