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
"""Share of the usual field of view's misfit that another may have to be believed."""
BESIDE = (0.9, 1.1)
"""Where nothing is usual, the best is believed if these multiples of it fit worse."""


def angles(beams: int, degrees: float) -> Array:
    """Beam angles ``(B,)`` from half of the field of view on the right, up.

    The last beam of an odd number is as far to the left. An even number ends one step before: Intel's map
    (180 beams, 180°) is sharpest so, and a full turn has its first beam only once.
    """
    step = degrees / max(beams - beams % 2, 1)
    return np.deg2rad(-0.5 * degrees + step * np.arange(beams, dtype=np.float64))


def describe(angles: Array) -> str:
    """``181 beams over 180°``, of beam angles ``(B,)``, a full turn being what its beams divide."""
    beams, span = len(angles), float(np.degrees(angles[-1] - angles[0]))
    whole_turn = span * beams / max(beams - 1, 1) > 359.9
    return f"{beams} beams over {360.0 if whole_turn else span:.4g}°"


def field_of_view(ranges: Array, poses: Array) -> tuple[float, bool] | None:
    """Degrees that ``ranges (N, B)`` span, and whether the scans say so (or it is merely usual).

    With the wrong one a scan does not fit the next when the robot, at dead-reckoned ``poses (N, 3)``, has
    turned. None where neither the scans nor the number of beams tell.
    """
    usual = USUAL.get(ranges.shape[1])
    step = se2.between(poses[:-1], poses[1:])
    pairs = _telling(step)
    if len(pairs) >= LEAST_PAIRS and ranges.shape[1] > 3:

        def misfit(degrees: float) -> float:
            each = [_misfit(ranges[k : k + 2], step[k], degrees) for k in pairs]
            return float(np.median(each))

        misfits = {degrees: misfit(degrees) for degrees in CANDIDATES}
        best = min(misfits, key=misfits.__getitem__)
        beside = [misfit(share * best) for share in BESIDE if usual is None and share * best <= 360.0]
        limit = min(beside) if usual is None else DECISIVE * misfits[usual]
        if best == usual or misfits[best] < limit:
            return best, True
    return None if usual is None else (usual, False)


def _telling(step: Array) -> np.ndarray:
    """Indices of the steps ``(N − 1, 3)`` that turn most for their way, at most `PAIRS`."""
    turn, way = np.abs(step[:, 2]), np.hypot(step[:, 0], step[:, 1])
    steps = np.flatnonzero((turn > TURN[0]) & (turn < TURN[1]))
    return steps[np.argsort(way[steps] / turn[steps], kind="stable")][:PAIRS]


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
    return float(np.median(away)) if len(away) > beams // 4 else np.inf
