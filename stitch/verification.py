"""Is this alignment true? Acceptance, or a reason against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.se2 import Array
from stitch.raster import Raster, dilated
from stitch.result import Prior


@dataclass(frozen=True)
class Acceptance:
    """What an alignment must show to be believed.

    ``min_overlap`` m² known in both maps and ``min_open`` m² free in both (two maps laid back to back
    along one wall share the wall only); ``min_odds``: log-odds that it is the same place
    (`stitch.likeness`), less is enough beside a prior (``min_odds_guided``), which leaves few other
    places; ``min_firmness``: share of the agreement that is lost within 0.4 m in every direction, as a
    bare corridor does not; ``min_lead``: log-odds ahead of any other
    alignment; ``max_rivalry``: of what the best has above the least log-odds, how much
    another may have: where two would do, neither is believed, as the better may just share more with the
    other map; ``max_innovation``: squared Mahalanobis distance from the prior, the default χ²₃(0.999).
    """

    min_overlap: float = 4.0
    min_open: float = 3.0
    min_odds: float = 0.4
    min_odds_guided: float = -1.0
    min_firmness: float = 0.1
    min_lead: float = 2.0
    max_rivalry: float = 0.3
    max_innovation: float = 16.27


@dataclass(frozen=True)
class Evidence:
    """What two rasters say about an alignment; the limits are those of `Acceptance`."""

    overlap_area: float
    open_area: float
    agreement: float


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
    """How an alignment stands: its log-``odds``, those of its best ``rival``, its ``firmness`` (see
    `Acceptance`), and whether a prior ``guided`` the search."""

    odds: float
    rival: float
    firmness: float
    guided: bool


def reason_against(evidence: Evidence, standing: Standing, acceptance: Acceptance) -> str | None:
    """The first limit an alignment breaks, in words, or None when it is believed."""
    least_odds = acceptance.min_odds_guided if standing.guided else acceptance.min_odds
    rivalry = max(standing.rival - least_odds, 0.0) / max(standing.odds - least_odds, 1e-9)
    checks = [
        ("overlap", evidence.overlap_area, acceptance.min_overlap, "m²", True),
        ("space free in both", evidence.open_area, acceptance.min_open, "m²", True),
        ("evidence (log-odds of being the same place)", standing.odds, least_odds, "", True),
        ("firmness (it slides along its walls)", standing.firmness, acceptance.min_firmness, "", True),
        (
            "ambiguity: lead over a rival in log-odds",
            standing.odds - standing.rival,
            acceptance.min_lead,
            "",
            True,
        ),
        ("ambiguity (odds of a rival)", rivalry, acceptance.max_rivalry, "", False),
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
