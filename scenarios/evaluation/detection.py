"""How well a measure finds lost steps: ranking, operating point and correlation, ties and +inf included.

Scores are larger where worse; a failed match is +inf, which is a tie with every other one. NaN is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata, spearmanr

from slam.se2 import Array


@dataclass(frozen=True)
class Decision:
    """Counts of a rule that calls steps lost: rightly, wrongly, and those that it missed."""

    right: int
    wrong: int
    missed: int

    def __add__(self, other: Decision) -> Decision:
        return Decision(self.right + other.right, self.wrong + other.wrong, self.missed + other.missed)

    @property
    def precision(self) -> float:
        """Share of the calls that were right; NaN without a call."""
        return _ratio(self.right, self.right + self.wrong)

    @property
    def recall(self) -> float:
        """Share of the lost steps that were called; NaN where none was lost."""
        return _ratio(self.right, self.right + self.missed)

    @property
    def f1(self) -> float:
        """Harmonic mean of the two; NaN where nothing was lost and nothing called."""
        return _ratio(2 * self.right, 2 * self.right + self.wrong + self.missed)


def decided(called: np.ndarray, lost: np.ndarray) -> Decision:
    """The decision ``called (n,)`` bool against what was ``lost (n,)``."""
    return Decision(int(np.sum(called & lost)), int(np.sum(called & ~lost)), int(np.sum(~called & lost)))


def roc_auc(scores: Array, lost: np.ndarray) -> float:
    """Chance that a lost step scores above one that is not, a tie counting half (Mann & Whitney 1947). NaN
    where all steps are of one kind."""
    scores, lost = _checked(scores, lost)
    positive = int(lost.sum())
    pairs = positive * (len(lost) - positive)
    if pairs == 0:
        return float("nan")
    return float((rankdata(scores)[lost].sum() - positive * (positive + 1) / 2.0) / pairs)


def precision_recall(scores: Array, lost: np.ndarray) -> tuple[Array, Array, Array]:
    """Precision and recall ``(K,)`` of calling lost what scores at least each of the K distinct
    ``thresholds (K,)``, from the highest down. Raises ``ValueError`` where no step is lost."""
    thresholds, right, called = _cumulated(scores, lost, np.ones(len(lost)))
    return right / called, right / np.sum(lost), thresholds


def average_precision(scores: Array, lost: np.ndarray) -> float:
    """Precision averaged over recall, Σ (R_k − R_{k−1}) P_k over distinct scores; NaN where no step is lost.

    A measure that knows nothing has the base rate. Equal scores are one threshold, as in scikit-learn: broken
    by the order of the steps, the ties of the thesis' ten failed matches alone would make its trace 0.824
    instead of 0.855.
    """
    if not np.any(lost):
        return float("nan")
    precision, recall, _ = precision_recall(scores, lost)
    return float(np.sum(np.diff(recall, prepend=0.0) * precision))


def spearman(a: Array, b: Array) -> float:
    """Rank correlation of ``(n,)`` and ``(n,)``, mid-ranks for ties; NaN where one is constant."""
    a, b = _checked_scores(a), _checked_scores(b)
    if np.all(a == a[0]) or np.all(b == b[0]):
        return float("nan")
    return float(spearmanr(a, b).statistic)


def best_threshold(scores: Array, lost: np.ndarray, weights: Array) -> float:
    """Largest threshold above which calling steps lost has the best F1, steps weighing ``weights (n,)``. What
    exceeds the threshold is called, and a score of +inf in any case: the answer is +inf where nothing else is
    worth calling. Raises ``ValueError`` where no step is lost."""
    steps, right, called = _cumulated(scores, lost, weights)
    f1 = 2.0 * right / (called + np.sum(weights * lost))
    # calling what is at least steps[k], so what exceeds a number below it
    if not np.isposinf(steps[0]):
        steps, f1 = np.concatenate([[np.inf], steps]), np.concatenate([[0.0], f1])
    best = int(np.argmax(f1))
    if best == 0:
        return float("inf")
    below = steps[best + 1] if best + 1 < len(steps) else steps[best] - max(1.0, abs(steps[best]))
    return float(below if np.isposinf(steps[best]) else 0.5 * (steps[best] + below))


def _cumulated(scores: Array, lost: np.ndarray, weights: Array) -> tuple[Array, Array, Array]:
    """The K distinct thresholds ``(K,)``, from the highest down; the ``weights (n,)`` of the lost steps that
    score at least so much, and those of all such steps."""
    scores, lost = _checked(scores, lost)
    if not lost.any():
        raise ValueError("scores: expected at least one lost step")
    order = np.argsort(-scores, kind="stable")
    thresholds = scores[order]
    last = np.append(thresholds[1:] != thresholds[:-1], True)  # inf - inf is no number: compare
    return thresholds[last], np.cumsum((weights * lost)[order])[last], np.cumsum(weights[order])[last]


def _checked(scores: Array, lost: np.ndarray) -> tuple[Array, np.ndarray]:
    scores, lost = _checked_scores(scores), np.asarray(lost)
    if scores.shape != lost.shape or lost.dtype != bool:
        raise ValueError(f"expected bool of one shape, {scores.shape}, got {lost.shape} {lost.dtype}")
    return scores, lost


def _checked_scores(scores: Array) -> Array:
    scores = np.asarray(scores, dtype=np.float64)
    if scores.ndim != 1 or np.isnan(scores).any():
        raise ValueError(f"scores: expected numbers (n,) or +inf, got NaN or shape {scores.shape}")
    return scores


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")
