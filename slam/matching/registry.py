"""Matchers by name: those we have, and whatever somebody adds."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from slam.matching.config import ICP, PLICP, WSM
from slam.matching.icp import IteratedMatcher
from slam.matching.reference import LocalMap, Reference
from slam.matching.result import Match, NoMatch
from slam.se2 import Array

Matcher = Callable[[Reference | LocalMap, Reference, Array, Array], Match | NoMatch]
"""``(reference, scan, guess (3,), prior (3, 3))`` to the pose of the scan in the frame of the reference.

The prior is information about the guess (additive errors, reference frame), zero where there is none.
"""

MATCHERS: dict[str, Matcher] = {
    "wsm": IteratedMatcher(WSM),
    "icp": IteratedMatcher(ICP),
    "plicp": IteratedMatcher(PLICP),
}
"""Name → matcher, which may be the ``method`` of a match or of a front end. A further one is a file of its
own and an entry here; `tests/slam/matching/test_registry.py` tries it on arrival."""


def register(name: str) -> str:
    """The name, after importing and registering the matcher if it is a ``module:function`` not known yet.

    Raises ``ValueError`` saying what is wrong with it.
    """
    if name in MATCHERS:
        return name
    module, _, function = name.partition(":")
    if not function:
        known = ", ".join(MATCHERS)
        raise ValueError(f"unknown matcher {name!r}: expected one of {known}, or MODULE:FUNCTION")
    try:
        matcher = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"matcher {name!r}: {error}") from error
    if not callable(matcher):
        raise ValueError(f"matcher {name!r}: expected a function, got {type(matcher).__name__}")
    MATCHERS[name] = matcher
    return name
