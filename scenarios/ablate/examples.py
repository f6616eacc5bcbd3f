"""Alignments that are known to be right or wrong, and what is learnt from them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from scenarios.ablate.pairs import Pair
from scenarios.ablate.trial import is_right
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.joint import AlignmentProblem, best_candidates
from stitch.alignment.likelihood import count_overlap
from stitch.alignment.raster import walls_of
from stitch.alignment.refinement import prior_penalty
from stitch.alignment.result import Prior

SPREAD = 0.1
"""Added to the spread of a feature, so that rare ones are not given large weights."""


@dataclass(frozen=True)
class Examples:
    """Alignments of pairs of maps.

    ``counts (n, 2, 3, 7)`` and ``gaps (n, 3)`` of `stitch.alignment.likelihood.OverlapCounts`;
    ``unlikely (n,)``: what the prior takes off the log-odds, 0 without one; ``right (n,)`` bool, by truth.
    """

    counts: Array
    gaps: Array
    unlikely: Array
    right: np.ndarray

    @classmethod
    def of_pair(cls, pair: Pair, prior: Prior | None, config: AlignConfig) -> Examples:
        """Every alignment that the search leads to."""
        walls_a, walls_b = walls_of(pair.a, config.resolution), walls_of(pair.b, config.resolution)
        problem = AlignmentProblem.of(walls_a, walls_b, prior, config)
        poses = [candidate.T_a_b for candidate in best_candidates(problem)]
        tallies = [count_overlap(problem.a, problem.b, T_a_b) for T_a_b in poses]
        counts = np.array([found.counts for found in tallies]).reshape(-1, 2, 3, 7)
        gaps = np.array([found.gaps for found in tallies]).reshape(-1, 3)
        unlikely = [float(prior_penalty(prior, T_a_b, 1.0)) for T_a_b in poses]
        right = [is_right(T_a_b, pair.T_a_b, pair.middle_b) for T_a_b in poses]
        return cls(counts, gaps, np.array(unlikely), np.array(right, dtype=bool))

    @staticmethod
    def packed(several: Sequence[Examples]) -> bytes:
        """As an ``.npz``, to be read by `unpacked`."""
        buffer = io.BytesIO()
        found = {
            f"{name}{k}": getattr(one, name) for k, one in enumerate(several) for name in Examples.names()
        }
        np.savez(buffer, allow_pickle=False, **found)
        return buffer.getvalue()

    @classmethod
    def unpacked(cls, content: bytes, number: int) -> list[Examples]:
        """So many as were packed."""
        with np.load(io.BytesIO(content), allow_pickle=False) as found:
            return [cls(*(found[f"{name}{k}"] for name in cls.names())) for k in range(number)]

    @classmethod
    def names(cls) -> list[str]:
        """Of the arrays."""
        return [field.name for field in fields(cls)]

    @classmethod
    def together(cls, several: Sequence[Examples]) -> Examples:
        """All of them as one; of none, no example."""
        none = cls(np.zeros((0, 2, 3, 7)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=bool))
        return cls(*(np.concatenate([getattr(e, name) for e in (none, *several)]) for name in cls.names()))


def fit(examples: Examples) -> tuple[Array, Array, float]:
    """Weights ``(2, 3, 7)`` and ``(3,)`` and the constant of
    `stitch.alignment.likelihood.overlap_log_odds`, from examples without a prior.

    Logistic regression on the square roots of the counts, each divided by its spread, with a unit normal
    prior on the weights.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    features = np.sqrt(_counted(examples))
    scale = features.std(axis=0) + SPREAD
    features, sign = features / scale, np.where(examples.right, 1.0, -1.0)

    def loss(theta: Array) -> tuple[float, Array]:
        margin = sign * (features @ theta[1:] + theta[0])
        pull = -sign * expit(-margin)
        gradient = np.concatenate([[pull.sum()], features.T @ pull + theta[1:]])
        return float(np.logaddexp(0.0, -margin).sum() + 0.5 * theta[1:] @ theta[1:]), gradient

    theta = minimize(loss, np.zeros(features.shape[1] + 1), jac=True, method="L-BFGS-B").x
    weights, gaps = np.split(theta[1:] / scale, [-3])
    return weights.reshape(2, 3, 7), gaps, float(theta[0])


def _counted(examples: Examples) -> Array:
    """All counts of each alignment, side by side ``(n, 45)``."""
    return np.concatenate([examples.counts.reshape(len(examples.right), 42), examples.gaps], axis=1)


def fit_guided(examples: Examples, weights: Array, gaps: Array, bias: float) -> float:
    """The constant that a prior adds to the log-odds, from examples with one."""
    from scipy.optimize import minimize_scalar

    odds = np.sqrt(_counted(examples)) @ np.concatenate([weights.ravel(), gaps]) + bias - examples.unlikely
    sign = np.where(examples.right, 1.0, -1.0)
    return float(
        minimize_scalar(lambda shift: np.logaddexp(0.0, -sign * (odds + shift)).sum(), bounds=(-20, 20)).x
    )
