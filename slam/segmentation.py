"""Cut a drive where confidence is lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slam.track import Track, Verdict

Rule = Literal["each_zero", "zero_run", "threshold"]


@dataclass(frozen=True)
class Segment:
    """Scans ``start..stop-1``."""

    start: int
    stop: int


@dataclass(frozen=True)
class SegmentationConfig:
    """``each_zero`` cuts at every step without matches (the report's Experiment 1), ``zero_run`` only at
    ``run`` or more of them in a row (Experiment 2), ``threshold`` where ``measure`` exceeds ``threshold``
    or failed. Segments of fewer than ``least_steps`` matched steps are discarded.
    """

    rule: Rule = "each_zero"
    run: int = 2
    measure: str = "trace2"
    threshold: float = np.inf
    least_steps: int = 1


def lost_steps(track: Track, config: SegmentationConfig = SegmentationConfig()) -> np.ndarray:
    """Scans ``(N,)`` bool at which the rule says that confidence is lost.

    Raises ``ValueError`` for an unknown measure.
    """
    if config.measure not in track.confidence:
        raise ValueError(f"measure: expected one of {sorted(track.confidence)}, got {config.measure!r}")
    column = track.confidence[config.measure]
    zero = np.isposinf(column)
    if config.rule == "threshold":
        return zero | (column > config.threshold)
    if config.rule == "each_zero":
        return zero
    tried = np.flatnonzero(~np.isnan(column))
    lost = np.zeros(len(track), dtype=bool)
    for first, last in _runs(zero[tried]):
        if last - first + 1 >= config.run:
            lost[tried[first : last + 1]] = True
    return lost


def segments(track: Track, config: SegmentationConfig = SegmentationConfig()) -> tuple[Segment, ...]:
    """Stretches of the drive between losses; the lost steps belong to none, scans skipped at rest follow
    them."""
    lost = lost_steps(track, config)
    resting = track.verdict == Verdict.SKIPPED
    inside = np.zeros(len(track), dtype=bool)
    steady = True
    for k in range(len(track)):
        steady = steady if resting[k] else not lost[k]
        inside[k] = steady
    found = [Segment(first, last + 1) for first, last in _runs(inside)]
    return tuple(s for s in found if np.sum(~resting[s.start : s.stop]) >= config.least_steps)


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return list(
        zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True)
    )
