"""Cut a drive where confidence is lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slam.cli import nearest
from slam.odometry.confidence import MEASURES
from slam.odometry.track import Track, Verdict

Rule = Literal["each_zero", "zero_run", "threshold"]

THRESHOLDS: dict[str, float] = {
    "trace2": 8.661e-05,
    "det2": 1.519e-09,
    "neg_matches": -30.5,
    "zero_match": np.inf,
    "zero_run2": np.inf,
    "neg_match_share": -0.3697,
    "a_opt": 0.002862,
    "d_opt": 0.0006827,
    "e_opt": 0.009739,
    "degeneracy": -1.314e04,
    "residual_rms": 1.019,
    "residual_p90": 0.1537,
    "misfit": 3.648,
    "innovation": 128,
    "tilt": 0.3492,
    "iterations": 32.5,
    "combined": -0.2668,
}
"""Of a measure: above it a step is more likely lost than worth keeping (best F1).

Learnt by ``python -m scenarios.ablate confidence`` from drives that no measure is compared on.
"""


@dataclass(frozen=True)
class Segment:
    """Scans ``start..stop-1``."""

    start: int
    stop: int


@dataclass(frozen=True)
class SegmentationConfig:
    """Where a drive is cut.

    Raises ``ValueError`` for an unknown measure, and for a release above the threshold.
    """

    rule: Rule = "each_zero"
    """``each_zero`` cuts at every step without matches (Formsma's Experiment 1), ``zero_run`` only at ``run``
    or more of them in a row (Experiment 2), ``threshold`` where ``measure`` exceeds ``threshold`` or has
    failed."""
    run: int = 2
    """Steps without matches in a row at which ``zero_run`` cuts."""
    measure: str = "trace2"
    """Measure of confidence, by its name in `slam.odometry.confidence.MEASURES`."""
    threshold: float = np.inf
    """Value of the measure above which ``threshold`` cuts, in the measure's unit."""
    release: float | None = None
    """The cut goes on until the measure is down to this (hysteresis); none without."""
    least_steps: int = 1
    """Segments of fewer matched steps are discarded."""

    def __post_init__(self) -> None:
        if self.measure not in MEASURES:
            raise ValueError(f"measure: unknown {self.measure!r}, {nearest(self.measure, MEASURES)}")
        if self.release is not None and not self.release <= self.threshold:
            raise ValueError(f"release: expected at most the threshold {self.threshold}, got {self.release}")


def lost_steps(track: Track, config: SegmentationConfig = SegmentationConfig()) -> np.ndarray:
    """Scans ``(N,)`` bool at which the rule says that confidence is lost.

    Raises ``ValueError`` for a measure that the track has not.
    """
    if config.measure not in track.confidence:
        raise ValueError(f"measure: expected one of {sorted(track.confidence)}, got {config.measure!r}")
    column = track.confidence[config.measure]
    zero = np.isposinf(column)
    if config.rule == "threshold":
        lost = zero | (column > config.threshold)
        return lost if config.release is None else _held(lost, column, config.release)
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
    return split_at_losses(lost_steps(track, config), track.verdict == Verdict.SKIPPED, config.least_steps)


def split_at_losses(lost: np.ndarray, resting: np.ndarray, least_steps: int = 1) -> tuple[Segment, ...]:
    """Stretches between the ``lost (N,)`` scans that have at least so many steps; those that were
    ``resting (N,)`` are none, and follow the one before."""
    inside = np.zeros(len(lost), dtype=bool)
    steady = True
    for k in range(len(lost)):
        steady = steady if resting[k] else not lost[k]
        inside[k] = steady
    found = [Segment(first, last + 1) for first, last in _runs(inside)]
    return tuple(s for s in found if np.sum(~resting[s.start : s.stop]) >= least_steps)


def _held(lost: np.ndarray, column: np.ndarray, release: float) -> np.ndarray:
    """Every ``lost (N,)`` step, and those after it until the ``column (N,)`` is down to the release; scans
    without a value change nothing."""
    held = lost.copy()
    holding = False
    for k in np.flatnonzero(~np.isnan(column)):
        holding = bool(lost[k]) or (holding and column[k] > release)
        held[k] = holding
    return held


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return list(
        zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True)
    )
