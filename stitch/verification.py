"""Is this alignment true? Acceptance, or a reason against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.raster import Raster, dilated
from stitch.result import Prior

SAME, CHANGED, CHANCE = 0.001, 0.05, 0.1
"""Share of the walls in the overlap that the other map has seen through: where both show the same place,
where something was moved in between or a map is bent, and where another place fits by chance."""
CHANGED_COUNTS = 0.5
"""Worth of a cell's evidence when something must have changed."""
DISPROVED = 0.04
"""Conflicts by which a rival must be worse, as a share of the walls in its overlap, to be none."""


@dataclass(frozen=True)
class Acceptance:
    """What an alignment must show to be believed.

    ``min_overlap`` m² known in both maps and ``min_open`` m² free in both (two maps laid back to back along
    one wall share the wall only); ``min_omega`` of Carpin's ω = agree/(agree + disagree) over cells (Carpin
    2008); ``min_agreement`` and ``max_conflict``: the share of the walls in the overlap that the other map
    has too, or has seen through; ``min_odds``: see `odds`, less is enough beside a prior
    (``min_odds_guided``); ``min_firmness``: share of the agreement that is lost within 0.4 m in every
    direction, as a bare corridor does not; ``max_peak_ratio``: how plausible the best rival may be, see
    `rivalry`; ``max_innovation``: squared Mahalanobis distance from the prior, the default χ²₃(0.999).
    """

    min_overlap: float = 4.0
    min_open: float = 3.0
    min_omega: float = 0.9
    min_agreement: float = 0.4
    max_conflict: float = 0.15
    min_odds: float = 12.0
    min_odds_guided: float = 0.0
    min_firmness: float = 0.25
    max_peak_ratio: float = 0.5
    max_innovation: float = 16.27


def odds(agreement: float, conflict: float) -> float:
    """Log-likelihood ratio of "the same place" against "another that fits by chance".

    ``agreement`` and ``conflict`` in cells, each cell a trial with probability `SAME` or `CHANGED` of a
    conflict, against `CHANCE`.
    """

    def against_chance(share: float) -> float:
        kept = agreement * np.log((1.0 - share) / (1.0 - CHANCE))
        return float(kept + conflict * np.log(share / CHANCE))

    return max(against_chance(SAME), CHANGED_COUNTS * against_chance(CHANGED))


def rivalry(best: tuple[float, float], other: tuple[float, float]) -> float:
    """How plausible another alignment is beside the best, 0 to 1; both as (agreement, conflict) in cells.

    That the best shares more with the other map is no proof: the maps may just have less in common. Only
    conflicts tell rivals apart.
    """
    worse = _conflict_share(other) - _conflict_share(best)
    size = min(1.0, other[0] / max(best[0], 1e-9))
    return size * float(np.clip(1.0 - worse / DISPROVED, 0.0, 1.0))


def _conflict_share(cells: tuple[float, float]) -> float:
    return cells[1] / max(cells[0] + cells[1], 1e-9)


@dataclass(frozen=True)
class Evidence:
    """What two rasters say about an alignment; the limits are those of `Acceptance`."""

    overlap_area: float
    open_area: float
    omega: float
    agreement: float
    conflict: float


NOTHING = Evidence(0.0, 0.0, 0.0, 0.0, 0.0)
"""Of maps that have nothing in common."""


def measure(a: Raster, b: Raster) -> Evidence:
    """Evidence from two rasters of one lattice, b already moved into the frame of a.

    Walls count as shared within one cell. Without walls in the overlap the agreement is 0 and the conflict 0;
    without any overlap ω is 0.
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
    agree = min(shared_a, shared_b) + open_both
    against = against_a + against_b
    return Evidence(
        overlap_area=float(np.sum((occupied_a | free_a) & (occupied_b | free_b))) * a.resolution**2,
        open_area=float(open_both) * a.resolution**2,
        omega=float(agree / max(agree + against, 1)),
        agreement=float(agreement[1] / max(agreement[0], 1)),
        conflict=float(against / max(walls_a + walls_b, 1)),
    )


def _window(cells: np.ndarray, raster: Raster, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    x0, y0 = (low - raster.first).astype(int)
    x1, y1 = (high - raster.first).astype(int)
    return cells[y0:y1, x0:x1]


@dataclass(frozen=True)
class Standing:
    """How an alignment stands: its `odds`, ``firmness``, the `rivalry` of the best other alignment, and
    whether a prior ``guided`` the search."""

    odds: float
    firmness: float
    rivalry: float
    guided: bool


def reason_against(evidence: Evidence, standing: Standing, acceptance: Acceptance) -> str | None:
    """The first limit an alignment breaks, in words, or None when it is believed."""
    least_odds = acceptance.min_odds_guided if standing.guided else acceptance.min_odds
    checks = [
        ("overlap", evidence.overlap_area, acceptance.min_overlap, "m²", True),
        ("space free in both", evidence.open_area, acceptance.min_open, "m²", True),
        ("agreement of the walls", evidence.agreement, acceptance.min_agreement, "", True),
        ("conflict of walls and free space", evidence.conflict, acceptance.max_conflict, "", False),
        ("agreement of the cells (omega)", evidence.omega, acceptance.min_omega, "", True),
        ("evidence (log-odds against chance)", standing.odds, least_odds, "", True),
        ("firmness (it slides along its walls)", standing.firmness, acceptance.min_firmness, "", True),
        ("ambiguity (plausibility of a rival)", standing.rivalry, acceptance.max_peak_ratio, "", False),
    ]
    for name, value, limit, unit, at_least in checks:
        if not (value >= limit if at_least else value <= limit):
            word = "at least" if at_least else "at most"
            return (
                f"{name} {value:.3g}{unit and ' ' + unit}, expected {word} {limit:.3g}{unit and ' ' + unit}"
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
