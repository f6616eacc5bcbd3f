"""Matchers by name: ours, and whatever somebody adds."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from slam.matching.reference import LocalMap, Reference
from slam.matching.result import Match, NoMatch
from slam.se2 import Array

Matcher = Callable[[Reference | LocalMap, Reference, Array, Array], Match | NoMatch]
"""``(reference, scan, guess (3,), prior (3, 3))`` to the pose of the scan in the frame of the reference.

The prior is information about the guess (additive errors, reference frame), zero where there is none.
"""

OURS = ("wsm", "icp", "plicp")

MATCHERS: dict[str, Matcher] = {}
"""Name → matcher, beside `OURS`: what is put here may be the ``method`` of a match or of a front end."""


def named(name: str) -> str:
    """The name of a matcher that is known from then on: one that is, or ``module:function`` to import.

    Raises ``ValueError`` saying what is wrong with it.
    """
    if name in OURS or name in MATCHERS:
        return name
    module, _, function = name.partition(":")
    if not function:
        known = ", ".join([*OURS, *MATCHERS])
        raise ValueError(f"unknown matcher {name!r}: expected one of {known}, or MODULE:FUNCTION")
    try:
        found = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"matcher {name!r}: {error}") from error
    if not callable(found):
        raise ValueError(f"matcher {name!r}: expected a function, got {type(found).__name__}")
    MATCHERS[name] = found
    return name
