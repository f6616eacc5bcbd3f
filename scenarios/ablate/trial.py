"""One pair, one method: was the answer right, was it given, and how long did it take?"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from scenarios.ablate.pairs import Pair
from slam import se2
from slam.se2 import Array
from stitch.align import AlignConfig, NoStitch, Prior, Stitch, align

Outcome = Literal["right", "false", "refused"]

LIMIT = (0.3, np.radians(2.0))
"""An accepted stitch is right within this (m at the middle of the overlap, rad)."""
PRIOR_SIGMA = (1.0, np.radians(10.0))
"""Of the prior, on each axis [m] and in yaw [rad]; its error is drawn from it."""


@dataclass(frozen=True)
class Variant:
    """A method as it is measured: by name, with or without a prior."""

    method: str
    prior: bool

    @property
    def name(self) -> str:
        """How tables call it."""
        return f"{self.method} + prior" if self.prior else self.method


@dataclass(frozen=True)
class Row:
    """One answer: errors are NaN where it was refused, ``nees`` where it has no covariance."""

    variant: str
    scenario: str
    seed: int
    bin: str
    overlap: float
    moved: bool
    hold: float
    outcome: Outcome
    error_m: float
    error_deg: float
    nees: float
    seconds: float
    reason: str


def attempt(pair: Pair, variant: Variant, config: AlignConfig, rng: np.random.Generator) -> Row:
    """Let a method answer, and judge it; ``rng`` draws the error of the prior. Seconds are processor time."""
    prior = drawn_prior(pair.T_a_b, rng) if variant.prior else None
    started = time.process_time()
    answer = align(pair.a, pair.b, prior, config)
    seconds = time.process_time() - started
    outcome, error, nees = judged(answer, pair.T_a_b, pair.middle_b)
    return Row(
        variant.name,
        pair.scenario,
        pair.seed,
        pair.bin,
        pair.overlap,
        pair.moved,
        pair.hold,
        outcome,
        *error,
        nees,
        seconds,
        answer.reason if isinstance(answer, NoStitch) else "",
    )


def drawn_prior(T_a_b: Array, rng: np.random.Generator) -> Prior:
    """A prior of `PRIOR_SIGMA` whose error is as large as it says."""
    sigma = np.array([PRIOR_SIGMA[0], PRIOR_SIGMA[0], PRIOR_SIGMA[1]])
    return Prior(se2.compose(T_a_b, sigma * rng.standard_normal(3)), np.diag(sigma**2))


def judged(
    answer: Stitch | NoStitch, T_a_b: Array, middle_b: Array
) -> tuple[Outcome, tuple[float, float], float]:
    """Outcome, error (m at b's point ``middle_b (2,)``, degrees) and squared Mahalanobis error."""
    if isinstance(answer, NoStitch):
        return "refused", (np.nan, np.nan), np.nan
    distance, angle = apart(answer.T_a_b, T_a_b, middle_b)
    nees = np.nan
    if answer.covariance is not None:
        xi = se2.log(se2.between(T_a_b, answer.T_a_b))
        nees = float(xi @ np.linalg.solve(answer.covariance, xi))
    return (
        ("right" if is_right(answer.T_a_b, T_a_b, middle_b) else "false"),
        (distance, float(np.degrees(angle))),
        nees,
    )


def apart(found: Array, truth: Array, middle_b: Array) -> tuple[float, float]:
    """How far two poses ``(3,)`` of b in a are from each other: m at b's point ``middle_b (2,)``, rad."""
    moved = se2.transform(found, middle_b[None]) - se2.transform(truth, middle_b[None])
    return float(np.linalg.norm(moved)), abs(float(se2.wrap(found[2] - truth[2])))


def is_right(found: Array, truth: Array, middle_b: Array) -> bool:
    """Whether a pose of b in a is within `LIMIT` of the truth."""
    distance, angle = apart(found, truth, middle_b)
    return distance <= LIMIT[0] and angle <= LIMIT[1]
