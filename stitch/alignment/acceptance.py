"""How far an alignment may be believed: what speaks for it and against it, weighed by experience."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from slam.se2 import Array
from stitch.alignment.verification import Evidence, Standing

NO_RIVAL = -20.0
"""Log-odds that stand for a rival where there is none, or hardly one."""
RIVALS = 3
SHARED = 4
"""A wall point is shared when it meets one within this class of `stitch.alignment.likelihood.DISTANCES`."""


@dataclass(frozen=True)
class Network:
    """Log-odds from F features through one hidden layer of H units.

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
        """Write it where `learnt` reads one."""
        weights: dict[str, Any] = {name: np.float32(value) for name, value in asdict(self).items()}
        np.savez_compressed(path, **weights)

    @classmethod
    @cache
    def learnt(cls) -> Network:
        """The one that comes with the package; ``python -m scenarios.ablate belief`` learns it."""
        with files("stitch.alignment").joinpath("acceptance.npz").open("rb") as file, np.load(file) as stored:
            return cls(*(stored[field.name].astype(np.float64) for field in fields(cls)))


def features(evidence: Evidence, standing: Standing) -> Array:
    """What is known of an alignment, as numbers ``(39,)`` of like size.

    Its odds, its rivals' and its lead, its firmness, the areas in common and the agreement; roots and
    logarithms of what its `stitch.alignment.likelihood.Tally` counts; what the prior says.
    """
    rivals = np.maximum([*standing.rivals[:RIVALS], *[NO_RIVAL] * RIVALS][:RIVALS], NO_RIVAL)
    counts, gaps = standing.tally.counts, standing.tally.gaps
    met, missed = counts[:, :, :-1], counts[:, :, -1]
    shared, against = met[:, 0, :SHARED].sum(axis=1), missed[:, :2].max(axis=1)
    return np.concatenate(
        [
            [standing.odds, *rivals, standing.odds - rivals[0], np.clip(standing.firmness, -1.0, 1.0)],
            np.log1p([evidence.overlap_area, evidence.open_area]),
            [evidence.agreement, shared.sum() / max(shared.sum() + against.sum(), 1)],
            np.sqrt(met[:, 0].ravel()),
            np.sqrt(met[:, 1].sum(axis=1)),
            np.log1p(shared),
            np.log1p(missed.ravel()),
            np.log1p(gaps),
            np.sqrt(gaps[1:]),
            [standing.unlikely, float(standing.guided)],
        ]
    )


def belief(evidence: Evidence, standing: Standing) -> float:
    """Log-odds that the alignment is right."""
    return float(Network.learnt().log_odds(features(evidence, standing)))
