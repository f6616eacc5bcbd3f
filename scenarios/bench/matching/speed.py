"""How long a match takes, by what one counts in."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scenarios.bench.matching.pairs import Pair
from scenarios.bench.matching.scores import Matcher
from slam.se2 import Array


@dataclass(frozen=True)
class Times:
    """Median processor time [ms] of a match.

    ``scans``: from two scans, as the scores have it. ``ready``: both made ready before (index, covariances).
    ``ranges``: from what the laser says, points and all that is read from them included.
    """

    scans: float
    ready: float
    ranges: float


def times(matchers: Mapping[str, Matcher], pairs: Sequence[Pair], guesses: Array) -> dict[str, Times]:
    """Times of all matchers, which take turns pair by pair so that what else the machine does meets all."""
    taken: dict[str, list[tuple[float, float, float]]] = {name: [] for name in matchers}
    for pair, guess in zip(pairs, guesses, strict=True):
        for name, matcher in matchers.items():
            taken[name].append(_timed(matcher, replace(pair), guess))  # a copy, whose scans are not read yet
    medians = {name: 1e3 * np.median(rows, axis=0) for name, rows in taken.items()}
    return {name: Times(float(m[0]), float(m[1]), float(m[2])) for name, m in medians.items()}


def _timed(matcher: Matcher, pair: Pair, guess: Array) -> tuple[float, float, float]:
    """Seconds of one match from scans, from what is ready, and from ranges."""
    start = time.process_time()
    given = [matcher.given(pair, which) for which in (0, 1)]
    have_scans = time.process_time()
    reference, scan = (matcher.ready(cloud) for cloud in given)
    matcher.answer(reference, scan, guess)
    end = time.process_time()
    matcher.answer(reference, scan, guess)
    again = time.process_time() - end
    return end - have_scans, again, end - start
