"""Where the beams of a laser point whose log states only how many there are."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.se2 import Array

USUAL = {180: 180, 181: 180, 360: 180, 361: 180, 541: 270, 1081: 270, 682: 240, 683: 240, 726: 240}
"""Number of beams → degrees, as CARMEN's SICK lasers, and Hokuyo's, have them."""
CANDIDATES = (180, 240, 270, 360)
"""Degrees that lasers on robots see."""
PAIRS, LEAST_PAIRS = 100, 10
"""Consecutive scans that are compared: those between which the robot turned most for its way, and the fewest
that tell something."""
TURN = np.radians((2.0, 45.0))
"""Least and most turn [rad] between two scans that are compared."""
DECISIVE = 0.5
"""Share of another field of view's misfit that the better one may have to be believed."""


def angles(beams: int, degrees: float) -> Array:
    """Beam angles ``(B,)`` from half of the field of view on the right, up.

    The last beam of an odd number is as far to the left. An even number ends one step before: Intel's map
    (180 beams, 180°) is sharpest so, and a full turn has its first beam only once.
    """
    step = np.radians(degrees) / max(beams - beams % 2, 1)
    return -0.5 * np.radians(degrees) + step * np.arange(beams)


def field_of_view(ranges: Array, poses: Array) -> tuple[float, bool] | None:
    """Degrees that ``ranges (N, B)`` span, and whether the scans say so (or it is merely usual).

    With the wrong one a scan does not fit the next when the robot, at dead-reckoned ``poses (N, 3)``, has
    turned. None where neither the scans nor the number of beams tell.
    """
    usual = USUAL.get(ranges.shape[1])
    misfit = _misfits(ranges, poses)
    if misfit:
        best = min(misfit, key=misfit.__getitem__)
        others = [usual] if usual else [degrees for degrees in CANDIDATES if degrees != best]
        if best == usual or all(misfit[best] < DECISIVE * misfit[other] for other in others):
            return best, True
    return None if usual is None else (usual, False)


def _misfits(ranges: Array, poses: Array) -> dict[int, float]:
    """Median difference [m] between a scan and what the one before it predicts, for each candidate.

    Empty where too few pairs of scans tell.
    """
    step = se2.between(poses[:-1], poses[1:])
    turn, way = np.abs(step[:, 2]), np.hypot(step[:, 0], step[:, 1])
    pairs = np.flatnonzero((turn > TURN[0]) & (turn < TURN[1]))
    pairs = pairs[np.argsort(way[pairs] / turn[pairs], kind="stable")][:PAIRS]
    if len(pairs) < LEAST_PAIRS or ranges.shape[1] < 4:
        return {}
    misfits = {c: np.nanmedian([_misfit(ranges[k : k + 2], step[k], c) for k in pairs]) for c in CANDIDATES}
    return (
        {c: float(misfit) for c, misfit in misfits.items()}
        if np.isfinite(list(misfits.values())).all()
        else {}
    )


def _misfit(pair: Array, step: Array, degrees: float) -> float:
    """Median difference [m] between ranges ``pair[1]`` and those that ``pair[0]`` predicts after ``step``."""
    beams = pair.shape[1]
    bearing = angles(beams, degrees)
    seen = np.isfinite(pair[0])
    ends = pair[0, seen, None] * np.stack([np.cos(bearing[seen]), np.sin(bearing[seen])], -1)
    moved = se2.transform(se2.inverse(step), ends)
    turned = np.mod(np.arctan2(moved[:, 1], moved[:, 0]) - bearing[0], 2.0 * np.pi)
    beam = np.round(turned / (bearing[1] - bearing[0])).astype(int)
    beam[beam == round(2.0 * np.pi / (bearing[1] - bearing[0]))] = 0
    inside = beam < beams
    away = np.abs(np.hypot(*moved[inside].T) - pair[1, beam[inside]])
    away = away[np.isfinite(away)]
    return float(np.median(away)) if len(away) > beams // 4 else np.nan
