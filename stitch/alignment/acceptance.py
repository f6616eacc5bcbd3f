"""Acceptance classifier: the log-odds that an alignment is right, from all its scores."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from slam.se2 import Array
from stitch.alignment.verification import SHARED_CLASSES, CandidateScores, SharedArea

NO_RIVAL = -20.0
"""Least log-odds of a rival, and those of one that does not exist. This and the next are part of what was
learnt: not settings."""
RIVALS = 3


@dataclass(frozen=True)
class AcceptanceClassifier:
    """Log-odds from F features, by a neural net with one hidden layer of H units.

    Features are centred by ``mean (F,)`` and divided by ``scale (F,)``; then
    ``tanh(x @ inner (F, H) + offset (H,)) @ outer (H,) + bias``.
    """

    mean: Array
    scale: Array
    inner: Array
    offset: Array
    outer: Array
    bias: Array

    def log_odds(self, features: Array) -> Array:
        """Log-odds ``(...)`` of features ``(..., F)``."""
        hidden = np.tanh((features - self.mean) / self.scale @ self.inner + self.offset)
        return hidden @ self.outer + self.bias

    def save(self, path: Path) -> None:
        """Write the weights as the ``.npz`` that `learnt` reads."""
        weights: dict[str, Any] = {name: np.float32(value) for name, value in asdict(self).items()}
        np.savez_compressed(path, **weights)

    @classmethod
    @cache
    def learnt(cls) -> AcceptanceClassifier:
        """The classifier that comes with the package; ``python -m scenarios.ablate belief`` learns it."""
        with files("stitch.alignment").joinpath("acceptance.npz").open("rb") as file, np.load(file) as stored:
            return cls(*(stored[field.name].astype(np.float64) for field in fields(cls)))


def features(shared: SharedArea, scores: CandidateScores) -> Array:
    """All scores of an alignment as numbers ``(39,)`` of like size.

    Its log-odds, its rivals' and its lead, its positional distinctness, the areas in common and the
    agreement; roots and logarithms of the overlap counts; the prior's penalty and whether there is one.
    """
    rivals = np.maximum([*scores.rivals[:RIVALS], *[NO_RIVAL] * RIVALS][:RIVALS], NO_RIVAL)
    counts, gaps = scores.overlap.counts, scores.overlap.gaps
    near, off = counts[:, :, :-1], counts[:, :, -1]
    same, against = near[:, 0, :SHARED_CLASSES].sum(axis=1), off[:, :2].max(axis=1)
    distinctness = np.clip(scores.positional_distinctness, -1.0, 1.0)
    return np.concatenate(
        [
            [scores.log_odds, *rivals, scores.log_odds - rivals[0], distinctness],
            np.log1p([shared.overlap_area, shared.open_area]),
            [shared.agreement, same.sum() / max(same.sum() + against.sum(), 1)],
            np.sqrt(near[:, 0].ravel()),
            np.sqrt(near[:, 1].sum(axis=1)),
            np.log1p(same),
            np.log1p(off.ravel()),
            np.log1p(gaps),
            np.sqrt(gaps[1:]),
            [scores.prior_penalty, float(scores.has_prior)],
        ]
    )


def acceptance_log_odds(shared: SharedArea, scores: CandidateScores) -> float:
    """Log-odds that the alignment is right."""
    return float(AcceptanceClassifier.learnt().log_odds(features(shared, scores)))
