"""What is learnt with scikit-learn, and from what: alignments that are known to be right or wrong.

What the classifiers say of new data is computed where it is used.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from typing import Any, Self

import numpy as np
from scipy.optimize import minimize_scalar

from scenarios.ablate.pair_sampling import STRANGERS, SubmapPair
from scenarios.ablate.study.stitching import draw_prior, is_right
from scenarios.ablate.trial_io import pack, unpack
from slam.cli import InputError
from slam.se2 import Array
from stitch.alignment.acceptance import AcceptanceClassifier, features
from stitch.alignment.config import AlignConfig
from stitch.alignment.joint import AlignmentProblem, best_candidates, score_best
from stitch.alignment.likelihood import count_overlap
from stitch.alignment.raster import walls_of
from stitch.alignment.refinement import prior_penalty
from stitch.alignment.result import Alternative, Prior

SPREAD = 0.1
"""Added to the standard deviation of a feature, so that rare ones are not given large weights."""
HIDDEN = 48
"""Units of the hidden layer of `fit_network`."""
RIDGE = 10.0
"""L2 penalty of `fit_network`: of half the squared sum of its weights, beside the sum of the log-losses."""
ITERATIONS = 400
"""Most iterations of L-BFGS in `fit_network`."""
FOLDS = 6
"""Most folds of the cross-validation."""


@dataclass(frozen=True)
class Columns:
    """A table whose columns are arrays with the same first dimension."""

    @classmethod
    def concat(cls, several: Iterable[Self]) -> Self:
        """The rows of all; at least one is expected."""
        several = list(several)
        return cls(*(np.concatenate([getattr(part, f.name) for part in several]) for f in fields(cls)))

    def to_bytes(self) -> bytes:
        """The table as an .npz file."""
        return pack(vars(self))

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """What `to_bytes` wrote."""
        return cls(**unpack(content))

    def where(self, rows: np.ndarray) -> Self:
        """The rows ``(n,)`` bool."""
        return type(self)(*(column[rows] for column in vars(self).values()))


@dataclass(frozen=True)
class CountedAlignments(Columns):
    """Every candidate of the search for some pairs, with its counts.

    ``counts (n, 2, 3, 7)`` and ``gaps (n, 3)`` of `stitch.alignment.likelihood.OverlapCounts`; ``unlikely
    (n,)``: what the prior takes off the log-odds, 0 without one; ``right (n,)`` bool, by truth; ``guided
    (n,)`` bool: with a prior.
    """

    counts: Array
    gaps: Array
    unlikely: Array
    right: np.ndarray
    guided: np.ndarray

    @classmethod
    def of_pair(cls, pair: SubmapPair, prior: Prior | None, config: AlignConfig) -> Self:
        """The candidates of a pair."""
        result = _search(pair, prior, config)
        if result is None:
            return cls.empty()
        problem, candidates = result
        poses = [candidate.T_a_b for candidate in candidates]
        overlaps = [count_overlap(problem.a, problem.b, T_a_b) for T_a_b in poses]
        return cls(
            np.array([overlap.counts for overlap in overlaps]),
            np.array([overlap.gaps for overlap in overlaps]),
            np.array([float(prior_penalty(prior, T_a_b, 1.0)) for T_a_b in poses]),
            np.array([is_right(T_a_b, pair.T_a_b, pair.middle_b) for T_a_b in poses]),
            np.full(len(poses), prior is not None),
        )

    @classmethod
    def empty(cls) -> Self:
        """No alignment."""
        nothing = np.zeros(0, dtype=bool)
        return cls(np.zeros((0, 2, 3, 7)), np.zeros((0, 3)), np.zeros(0), nothing, nothing)

    @property
    def features(self) -> Array:
        """Square roots of all counts of each alignment ``(n, 45)``."""
        return np.sqrt(np.concatenate([self.counts.reshape(len(self.right), 42), self.gaps], axis=1))


@dataclass(frozen=True)
class Dataset(Columns):
    """The likeliest alignments of n pairs.

    ``features (n, 39)`` of `stitch.alignment.acceptance.features`; ``right (n,)`` bool by the truth;
    ``allowed (n,)`` bool: they pass the limits that do not depend on what is learnt; ``guided (n,)`` bool:
    with a prior; ``bin (n,)`` names; ``building (n,)`` numbers.
    """

    features: Array
    right: np.ndarray
    allowed: np.ndarray
    guided: np.ndarray
    bin: np.ndarray
    building: np.ndarray


def _search(
    pair: SubmapPair, prior: Prior | None, config: AlignConfig
) -> tuple[AlignmentProblem, list[Alternative]] | None:
    """What the search is in, and its candidates; None without any."""
    walls_a, walls_b = (walls_of(submap, config.resolution, config.walls) for submap in (pair.a, pair.b))
    if len(walls_a.points) == 0 or len(walls_b.points) == 0:
        return None
    problem = AlignmentProblem.of(walls_a, walls_b, prior, config)
    candidates = best_candidates(problem)
    return (problem, candidates) if candidates else None


def collect_samples(pairs: Sequence[SubmapPair], guided: bool, rng: np.random.Generator) -> Dataset:
    """The likeliest alignments of pairs, if any, with priors drawn by ``rng`` where ``guided``."""
    config, rows = AlignConfig(), []
    for pair in pairs:
        prior = draw_prior(pair.T_a_b, rng) if guided else None
        result = _search(pair, prior, config)
        if result is None:
            continue
        problem, candidates = result
        shared, scores = score_best(problem, candidates)
        right = pair.bin != STRANGERS and is_right(candidates[0].T_a_b, pair.T_a_b, pair.middle_b)
        limits = config.acceptance
        allowed = (
            shared.overlap_area >= limits.min_overlap
            and shared.open_area >= limits.min_open
            and scores.lead >= limits.min_lead
            and scores.ambiguity_ratio <= limits.max_ambiguity
        )
        rows.append((features(shared, scores), right, allowed, guided, pair.bin, pair.seed))
    columns = list(zip(*rows, strict=True)) if rows else [np.zeros((0, 39)), *[()] * 5]
    kinds = (np.float64, bool, bool, bool, np.str_, np.int64)
    return Dataset(*(np.array(column, dtype=kind) for column, kind in zip(columns, kinds, strict=True)))


def fit_likelihood(alignments: CountedAlignments) -> tuple[Array, Array, float]:
    """Weights ``(2, 3, 7)``, ``(3,)`` and the constant of `stitch.alignment.likelihood.overlap_log_odds`, by
    logistic regression on the features of alignments without a prior over their standard deviations."""
    scale = alignments.features.std(axis=0) + SPREAD
    weights, bias = fit_logistic(alignments.features / scale, alignments.right)
    by_count, by_gap = np.split(weights / scale, [-3])
    return by_count.reshape(2, 3, 7), by_gap, bias


def fit_prior_offset(alignments: CountedAlignments, weights: Array, gaps: Array, bias: float) -> float:
    """The constant that having a prior adds to the log-odds, from alignments with one."""
    odds = alignments.features @ np.concatenate([weights.ravel(), gaps]) + bias - alignments.unlikely
    sign = np.where(alignments.right, 1.0, -1.0)
    loss = minimize_scalar(lambda shift: np.logaddexp(0.0, -sign * (odds + shift)).sum(), bounds=(-20, 20))
    return float(loss.x)


def require(module: str = "") -> Any:
    """A module of scikit-learn. Raises `InputError` where it is not installed."""
    try:
        return import_module(f"sklearn.{module}" if module else "sklearn")
    except ImportError as error:
        raise InputError("training needs scikit-learn: pip install 'slamstitch[train]'") from error


def fit_logistic(features: Array, positive: np.ndarray, weights: Array | None = None) -> tuple[Array, float]:
    """Weights ``(F,)`` and bias of an L2-penalised logistic regression on ``features (n, F)``."""
    model = require("linear_model").LogisticRegression(C=1.0, tol=1e-8, max_iter=10_000)
    model.fit(features, positive, sample_weight=weights)
    return model.coef_[0], float(model.intercept_[0])


def fit_network(features: Array, positive: np.ndarray, rng: np.random.Generator) -> AcceptanceClassifier:
    """The network of `stitch.alignment.acceptance` for ``features (n, F)``, from a start drawn by ``rng``."""
    network = require("neural_network").MLPClassifier(
        (HIDDEN,),
        activation="tanh",
        solver="lbfgs",
        alpha=RIDGE,
        max_iter=ITERATIONS,
        random_state=int(rng.integers(2**31)),
    )
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-3
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", require("exceptions").ConvergenceWarning)  # so many are enough
        network.fit((features - mean) / scale, positive)
    (inner, outer), (offset, bias) = network.coefs_, network.intercepts_
    return AcceptanceClassifier(mean, scale, inner, offset, outer[:, 0], bias[0])


def cross_validate(
    features: Array, positive: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> Array:
    """Log-odds ``(n,)`` of every example by a network that was trained on other ``groups (n,)`` only."""
    folds = require("model_selection").GroupKFold(min(FOLDS, len(np.unique(groups))))
    log_odds = np.full(len(positive), np.nan)
    for train, test in folds.split(features, positive, groups):
        log_odds[test] = fit_network(features[train], positive[train], rng).log_odds(features[test])
    return log_odds
