"""Answers that are known to be right or wrong, and the network that learns from them what to believe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from scenarios.ablate.pairs import Pair
from scenarios.ablate.trial import drawn_prior, is_right
from slam.se2 import Array
from stitch.alignment.acceptance import AcceptanceClassifier, features
from stitch.alignment.config import AlignConfig
from stitch.alignment.joint import AlignmentProblem, best_candidates, score_best
from stitch.alignment.raster import walls_of

HIDDEN = 48
"""Units of the hidden layer."""
RIDGE = 10.0
"""Weight of half the squared sum of the weights, beside the sum of the log-losses."""
FOLDS = 6
STRANGERS = "strangers"
"""The bin of pairs from two different buildings."""


@dataclass(frozen=True)
class Lessons:
    """The likeliest alignments of n pairs.

    ``features (n, 39)`` of `stitch.alignment.acceptance.features`; ``right (n,)`` bool by the truth;
    ``allowed (n,)`` bool: they pass the limits that do not depend on belief; ``guided (n,)`` bool: with a
    prior; ``bin (n,)`` names; ``building (n,)`` numbers.
    """

    features: Array
    right: np.ndarray
    allowed: np.ndarray
    guided: np.ndarray
    bin: np.ndarray
    building: np.ndarray

    @classmethod
    def together(cls, several: Sequence[Lessons]) -> Lessons:
        """All of them as one."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(lessons, name) for lessons in several]) for name in names))

    def of(self, rows: np.ndarray) -> Lessons:
        """Some of them."""
        return Lessons(*(getattr(self, field.name)[rows] for field in fields(self)))


def lessons(pairs: Sequence[Pair], guided: bool, rng: np.random.Generator) -> Lessons:
    """What the search answers for pairs, with priors drawn by ``rng`` or without; pairs without any answer
    teach nothing."""
    config, found = AlignConfig(), []
    for pair in pairs:
        prior = drawn_prior(pair.T_a_b, rng) if guided else None
        walls_a, walls_b = walls_of(pair.a, config.resolution), walls_of(pair.b, config.resolution)
        if len(walls_a.points) == 0 or len(walls_b.points) == 0:
            continue
        problem = AlignmentProblem.of(walls_a, walls_b, prior, config)
        candidates = best_candidates(problem)
        if not candidates:
            continue
        shared, scores = score_best(problem, candidates)
        right = pair.bin != STRANGERS and is_right(candidates[0].T_a_b, pair.T_a_b, pair.middle_b)
        limits = config.acceptance
        allowed = (
            shared.overlap_area >= limits.min_overlap
            and shared.open_area >= limits.min_open
            and scores.lead >= limits.min_lead
            and scores.ambiguity_ratio <= limits.max_ambiguity
        )
        found.append((features(shared, scores), right, allowed, guided, pair.bin, pair.seed))
    columns = list(zip(*found, strict=True)) if found else [()] * 6
    kinds = (np.float64, bool, bool, bool, np.str_, np.int64)
    arrays = [np.array(column, dtype=kind) for column, kind in zip(columns, kinds, strict=True)]
    return Lessons(arrays[0].reshape(len(found), -1 if found else 39), *arrays[1:])


def strangers(pairs: Sequence[Pair], others: Sequence[Pair]) -> list[Pair]:
    """Pairs made of the first map of each of ``pairs`` and the second of one of another building."""
    return [
        replace(pair, bin=STRANGERS, b=other.b, middle_b=other.middle_b, overlap=0.0)
        for pair, other in zip(pairs, others, strict=False)
    ]


def fit(given: Lessons, rng: np.random.Generator) -> AcceptanceClassifier:
    """The network with the least log-loss and ridge, from a start drawn by ``rng``."""
    from scipy.optimize import minimize
    from scipy.special import expit

    mean, scale = given.features.mean(axis=0), given.features.std(axis=0) + 1e-3
    x, sign = (given.features - mean) / scale, np.where(given.right, 1.0, -1.0)
    count = x.shape[1]

    def loss(theta: Array) -> tuple[float, Array]:
        """Log-loss and ridge of the weights, and their gradient."""
        inner, offset, outer, bias = _parts(theta, count)
        hidden = np.tanh(x @ inner + offset)
        margin = sign * (hidden @ outer + bias)
        pull = -sign * expit(-margin)
        back = pull[:, None] * outer * (1.0 - hidden**2)
        gradient = [
            (x.T @ back + RIDGE * inner).ravel(),
            back.sum(axis=0),
            hidden.T @ pull + RIDGE * outer,
            [pull.sum()],
        ]
        size = np.sum(inner**2) + np.sum(outer**2)
        return float(np.logaddexp(0.0, -margin).sum() + 0.5 * RIDGE * size), np.concatenate(gradient)

    start = np.concatenate(
        [
            rng.normal(0.0, 1.0 / np.sqrt(count), count * HIDDEN),
            np.zeros(HIDDEN),
            rng.normal(0.0, 1.0 / np.sqrt(HIDDEN), HIDDEN),
            [0.0],
        ]
    )
    theta = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 400}).x
    return AcceptanceClassifier(mean, scale, *_parts(theta, count))


def _parts(theta: Array, count: int) -> tuple[Array, Array, Array, Array]:
    """Inner weights, offsets, outer weights and bias from one vector."""
    inner, offset, outer, bias = np.split(theta, np.cumsum([count * HIDDEN, HIDDEN, HIDDEN]))
    return inner.reshape(count, HIDDEN), offset, outer, bias[0]


def crossed(given: Lessons, rng: np.random.Generator) -> Array:
    """Log-odds ``(n,)`` of every alignment by a network that learnt from other buildings."""
    fold = given.building % FOLDS
    odds = np.full(len(given.right), np.nan)
    for k in np.unique(fold):
        odds[fold == k] = fit(given.of(fold != k), rng).log_odds(given.features[fold == k])
    return odds
