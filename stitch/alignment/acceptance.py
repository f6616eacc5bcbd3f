"""Acceptance: what two maps share, the log-odds that an alignment is right, and what speaks against it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from slam.mapping.occupancy import dilated
from slam.se2 import Array
from stitch.alignment.config import Acceptance
from stitch.alignment.likelihood import OverlapCounts
from stitch.alignment.raster import Raster, common_windows

NO_RIVAL = -20.0
"""Least log-odds of a rival, and those of one that does not exist. This and the next two are part of what was
learnt: not settings."""
RIVALS = 3
SHARED_CLASSES = 4
"""A wall point is shared when its distance is in one of the first so many classes of
`stitch.alignment.likelihood.DISTANCES`. Part of what was learnt: not a setting."""


@dataclass(frozen=True)
class SharedArea:
    """What two maps have in common: ``overlap_area`` m² known in both, ``open_area`` m² free in both, and
    ``agreement``, the share of the walls there that both have."""

    overlap_area: float
    open_area: float
    agreement: float


def measure_shared_area(a: Raster, b: Raster) -> SharedArea:
    """What two rasters of one lattice share, b already moved into the frame of a.

    Walls count as shared within one cell; the agreement is that of the map with fewer walls there, 0 without
    any. Raises ``ValueError`` for rasters of different resolution.
    """
    if a.resolution != b.resolution:
        raise ValueError(f"rasters of different resolution: {a.resolution} and {b.resolution}")
    windows = common_windows(a, b)
    if windows is None:
        return SharedArea(0.0, 0.0, 0.0)
    in_a, in_b = windows
    occupied_a, free_a, near_a = a.occupied[in_a], a.free[in_a], dilated(a.occupied)[in_a]
    occupied_b, free_b, near_b = b.occupied[in_b], b.free[in_b], dilated(b.occupied)[in_b]
    shared_a, shared_b = np.sum(occupied_a & near_b), np.sum(occupied_b & near_a)
    against_a, against_b = np.sum(occupied_a & free_b), np.sum(occupied_b & free_a)
    walls_a, walls_b = shared_a + against_a, shared_b + against_b
    agreement = min((walls_a, shared_a), (walls_b, shared_b))
    open_both = np.sum(free_a & free_b)
    return SharedArea(
        overlap_area=float(np.sum((occupied_a | free_a) & (occupied_b | free_b))) * a.resolution**2,
        open_area=float(open_both) * a.resolution**2,
        agreement=float(agreement[1] / max(agreement[0], 1)),
    )


@dataclass(frozen=True)
class CandidateScores:
    """Scores of the best candidate of an alignment.

    ``log_odds`` of its overlap likelihood; ``rivals``: those of the other candidates, best first;
    ``positional_distinctness``, at most 1: smallest relative loss of agreement when it is shifted by
    `Acceptance.slide`, about 0 along a featureless corridor; the ``overlap`` counts; ``prior_penalty``: half
    its squared Mahalanobis distance from the prior, 0 without one; ``has_prior``; ``equals``: how many of the
    others `fits_as_well`.
    """

    log_odds: float
    rivals: tuple[float, ...]
    positional_distinctness: float
    overlap: OverlapCounts
    prior_penalty: float
    has_prior: bool
    equals: int = 0

    @property
    def best_rival(self) -> float:
        """Log-odds of the best other candidate; -inf where there is none."""
        return self.rivals[0] if self.rivals else -np.inf

    @property
    def lead(self) -> float:
        """Log-odds ahead of the best other candidate."""
        return self.log_odds - self.best_rival

    @property
    def ambiguity_ratio(self) -> float:
        """Log-odds of the best other candidate, where above 0, as a share of the best's."""
        return max(self.best_rival, 0.0) / max(self.log_odds, 1e-9)

    def main_weakness(self, limits: Acceptance) -> str:
        """What speaks against it most, in words."""
        if self.positional_distinctness < limits.sliding:
            return "it slides along its walls"
        if self.lead < limits.close_lead:
            return f"a rival has {self.best_rival:.1f} where it has {self.log_odds:.1f}"
        return f"its walls alone give {self.log_odds:.1f}"


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


def fits_as_well(rival: OverlapCounts, best: OverlapCounts, limits: Acceptance) -> bool:
    """Whether a rival brings as many walls together as the best candidate and puts hardly more of them into
    free space: in a room that looks the same when turned, the likelihood does not tell which is right.
    """
    shared_rival, shared_best = (int(n.counts[:, ::2, :SHARED_CLASSES].sum()) for n in (rival, best))
    against_rival, against_best = (int(n.counts[:, :2, -1].sum()) for n in (rival, best))
    if shared_rival < limits.equal_walls * shared_best:
        return False
    return against_rival - against_best <= limits.equal_conflict * shared_rival


def reason_against(
    shared: SharedArea, scores: CandidateScores, belief: float, limits: Acceptance
) -> str | None:
    """The first limit that an alignment breaks, in words; None when it is believed."""
    if scores.equals and shared.open_area >= limits.min_open:  # where hardly anything is shared, that is why
        return f"ambiguity: turned, it would fit as well ({scores.equals} other candidates of that kind)"
    weakness = f" ({scores.main_weakness(limits)})"
    checks = [
        ("overlap", shared.overlap_area, limits.min_overlap, " m²", ""),
        ("space free in both", shared.open_area, limits.min_open, " m²", ""),
        ("ambiguity: lead over a rival", scores.lead, limits.min_lead, "", ""),
        ("belief (log-odds of being right)", belief, limits.min_belief, "", weakness),
    ]
    for name, value, limit, unit, because in checks:
        if not value >= limit:  # nor is NaN enough
            return f"{name} {value:.3g}{unit}, expected at least {limit:.3g}{unit}{because}"
    if not scores.ambiguity_ratio <= limits.max_ambiguity:
        return (
            f"ambiguity: a rival has {scores.ambiguity_ratio:.3g} of the log-odds, expected at most "
            f"{limits.max_ambiguity:.3g}"
        )
    return None
