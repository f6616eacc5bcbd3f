"""Is this alignment true? Acceptance, or a reason against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.alignment.likelihood import Tally
from stitch.alignment.raster import Raster, dilated
from stitch.alignment.result import Prior


@dataclass(frozen=True)
class Acceptance:
    """What an alignment must show to be believed.

    ``min_overlap`` m² known in both maps and ``min_open`` m² free in both (two maps laid back to back along
    one wall share the wall only); ``min_lead``: log-odds of likeness ahead of any other alignment;
    ``max_rivalry``: log-odds of another as a share of the best's: where two would do, neither is believed, as
    the better may just share more with the other map; ``min_belief``: log-odds that it is right, by all that
    speaks for it and against it (`stitch.alignment.acceptance`); ``max_innovation``: squared Mahalanobis
    distance from the prior, the default χ²₃(0.999).
    """

    min_overlap: float = 4.0
    min_open: float = 3.0
    min_lead: float = 1.0
    max_rivalry: float = 0.5
    min_belief: float = 0.0
    max_innovation: float = 16.27


@dataclass(frozen=True)
class Evidence:
    """What two rasters say about an alignment; the limits are those of `Acceptance`."""

    overlap_area: float
    open_area: float
    agreement: float


SLIDING, CLOSE = 0.1, 4.0
"""Firmness and lead below which they are named as what speaks against an alignment."""

NOTHING = Evidence(0.0, 0.0, 0.0)
"""Of maps that have nothing in common."""


def measure(a: Raster, b: Raster) -> Evidence:
    """Evidence from two rasters of one lattice, b already moved into the frame of a.

    Walls count as shared within one cell. Without walls in the overlap the agreement is 0.
    """
    if a.resolution != b.resolution:
        raise ValueError(f"rasters of different resolution: {a.resolution} and {b.resolution}")
    low = np.maximum(a.first, b.first).astype(int)
    high = np.minimum(a.first + a.occupied.shape[::-1], b.first + b.occupied.shape[::-1]).astype(int)
    if np.any(high <= low):
        return NOTHING
    near_a, near_b = dilated(a.occupied), dilated(b.occupied)
    occupied_a, free_a, near_a = (_window(cells, a, low, high) for cells in (a.occupied, a.free, near_a))
    occupied_b, free_b, near_b = (_window(cells, b, low, high) for cells in (b.occupied, b.free, near_b))
    shared_a, shared_b = np.sum(occupied_a & near_b), np.sum(occupied_b & near_a)
    against_a, against_b = np.sum(occupied_a & free_b), np.sum(occupied_b & free_a)
    walls_a, walls_b = shared_a + against_a, shared_b + against_b
    agreement = min((walls_a, shared_a), (walls_b, shared_b))  # of the map with fewer walls in the overlap
    open_both = np.sum(free_a & free_b)
    return Evidence(
        overlap_area=float(np.sum((occupied_a | free_a) & (occupied_b | free_b))) * a.resolution**2,
        open_area=float(open_both) * a.resolution**2,
        agreement=float(agreement[1] / max(agreement[0], 1)),
    )


def _window(cells: np.ndarray, raster: Raster, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    x0, y0 = (low - raster.first).astype(int)
    x1, y1 = (high - raster.first).astype(int)
    return cells[y0:y1, x0:x1]


@dataclass(frozen=True)
class Standing:
    """How an alignment stands: its log-``odds`` of likeness, those of the ``rivals``, the best first; its
    ``firmness``: share of the agreement that is lost within 0.4 m in every direction, as a bare corridor
    does not; the ``tally`` of what its walls met; how ``unlikely`` the prior finds it (half a squared
    Mahalanobis distance), and whether a prior ``guided`` the search.
    """

    odds: float
    rivals: tuple[float, ...]
    firmness: float
    tally: Tally
    unlikely: float
    guided: bool

    @property
    def rival(self) -> float:
        """Log-odds of the best other alignment; -inf where there is none."""
        return self.rivals[0] if self.rivals else -np.inf

    @property
    def rivalry(self) -> float:
        """What the rival's log-odds have above even, as a share of what the best's have."""
        return max(self.rival, 0.0) / max(self.odds, 1e-9)

    @property
    def weakness(self) -> str:
        """What speaks against it most, in words."""
        if self.firmness < SLIDING:
            return "it slides along its walls"
        if self.odds - self.rival < CLOSE:
            return f"a rival has {self.rival:.1f} where it has {self.odds:.1f}"
        return f"its walls alone give {self.odds:.1f}"


def reason_against(
    evidence: Evidence, standing: Standing, belief: float, acceptance: Acceptance
) -> str | None:
    """The first limit an alignment breaks, in words, or None when it is believed."""
    checks = [
        ("overlap", evidence.overlap_area, acceptance.min_overlap, " m²", ""),
        ("space free in both", evidence.open_area, acceptance.min_open, " m²", ""),
        ("ambiguity: lead over a rival", standing.odds - standing.rival, acceptance.min_lead, "", ""),
        ("belief (log-odds of being right)", belief, acceptance.min_belief, "", f" ({standing.weakness})"),
    ]
    for name, value, limit, unit, because in checks:
        if not value >= limit:  # NaN is no evidence either
            return f"{name} {value:.3g}{unit}, expected at least {limit:.3g}{unit}{because}"
    if not standing.rivalry <= acceptance.max_rivalry:
        return (
            f"ambiguity: a rival has {standing.rivalry:.3g} of the log-odds, expected at most "
            f"{acceptance.max_rivalry:.3g}"
        )
    return None


def far_from(prior: Prior | None, T_a_b: Array, covariance: Array, acceptance: Acceptance) -> str | None:
    """Why an alignment, with its covariance ``(3, 3)``, does not fit the prior; None when it does."""
    if prior is None:
        return None
    error = se2.log(se2.between(prior.T_a_b, T_a_b))
    distance = float(error @ np.linalg.solve(prior.covariance + covariance, error))
    if distance <= acceptance.max_innovation:
        return None
    return f"distance from the prior {distance:.3g}, expected at most {acceptance.max_innovation:.3g}"
