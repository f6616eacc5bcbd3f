"""Is this alignment true? Acceptance, or a reason against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stitch.raster import Raster, dilated


@dataclass(frozen=True)
class Acceptance:
    """What an alignment must show to be believed.

    ``min_overlap`` m² known in both maps and ``min_open`` m² free in both (two maps laid back to back along
    one wall share the wall only); ``min_omega`` of Carpin's ω = agree/(agree + disagree) over cells (Carpin
    2008); ``min_agreement`` and ``max_conflict``: the share of the walls in the overlap that the other map
    has too, or has seen through; ``max_peak_ratio`` of the best distinct alternative's score;
    ``max_innovation``: squared Mahalanobis distance from the prior, the default χ²₃(0.999).
    """

    min_overlap: float = 4.0
    min_open: float = 3.0
    min_omega: float = 0.9
    min_agreement: float = 0.4
    max_conflict: float = 0.05
    max_peak_ratio: float = 0.9
    max_innovation: float = 16.27


@dataclass(frozen=True)
class Evidence:
    """What two rasters say about an alignment; the limits are those of `Acceptance`."""

    overlap_area: float
    open_area: float
    omega: float
    agreement: float
    conflict: float


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
        return Evidence(0.0, 0.0, 0.0, 0.0, 0.0)
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


def reason_against(
    evidence: Evidence,
    peak_ratio: float | None,
    innovation: float | None,
    acceptance: Acceptance,
) -> str | None:
    """The first limit an alignment breaks, in words, or None when it is believed.

    ``peak_ratio`` is None when there was no alternative, ``innovation`` when there was no prior.
    """
    checks = [
        ("overlap", evidence.overlap_area, acceptance.min_overlap, "m²", True),
        ("space free in both", evidence.open_area, acceptance.min_open, "m²", True),
        ("agreement of the walls", evidence.agreement, acceptance.min_agreement, "", True),
        ("conflict of walls and free space", evidence.conflict, acceptance.max_conflict, "", False),
        ("agreement of the cells (omega)", evidence.omega, acceptance.min_omega, "", True),
    ]
    if peak_ratio is not None:
        checks.append(("ambiguity (second peak / first)", peak_ratio, acceptance.max_peak_ratio, "", False))
    if innovation is not None:
        checks.append(("distance from the prior", innovation, acceptance.max_innovation, "", False))
    for name, value, limit, unit, at_least in checks:
        if not (value >= limit if at_least else value <= limit):
            word = "at least" if at_least else "at most"
            return (
                f"{name} {value:.3g}{unit and ' ' + unit}, expected {word} {limit:.3g}{unit and ' ' + unit}"
            )
    return None
