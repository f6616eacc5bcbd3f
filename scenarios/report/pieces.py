"""The pieces that a stitch was made of, and where it put them."""

from __future__ import annotations

import numpy as np

from scenarios.report.evidence import RESOLUTION, Walls
from slam import se2
from slam.se2 import Array
from stitch.alignment.result import Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

MERGING = ("htms",)
"""Methods that stitch each piece to the map of all before it, in the frame of the first."""


def state(tried: LoopCandidate, false: bool | None) -> str:
    """``accepted``, ``false`` (accepted and untrue), ``rejected`` (by the graph) or ``refused`` (by the
    stitching)."""
    if not isinstance(tried.result, Stitch):
        return "refused"
    if not tried.accepted:
        return "rejected"
    return "false" if false else "accepted"


def pose_of(tried: LoopCandidate) -> Array | None:
    """Where the stitch, or the best candidate of a refusal, has b in the frame of a."""
    if isinstance(tried.result, Stitch):
        return tried.result.T_a_b
    return None if tried.result.best is None else tried.result.best.T_a_b


def piece(estimate: Estimate, k: int) -> Walls:
    """The walls of one submap."""
    grid = estimate.submaps[k].grid
    return Walls(grid.occupied_points(), grid)


def merged(estimate: Estimate, b: int) -> Walls:
    """What piece ``b`` was stitched to, for methods of `MERGING`: all pieces before it, thinned to cells."""
    parts = [estimate.submaps[0].grid.occupied_points()]
    for tried in estimate.stitches:
        if tried.b < b:
            points = estimate.submaps[tried.b].grid.occupied_points()
            parts.append(se2.transform(placed(estimate, tried), points))
    cells = np.unique(np.floor(np.concatenate(parts) / RESOLUTION).astype(np.int64), axis=0)
    return Walls((cells + 0.5) * RESOLUTION, None)


def placed(estimate: Estimate, tried: LoopCandidate) -> Array:
    """Where the method left b in the frame of a: as stitched, else where it was."""
    if isinstance(tried.result, Stitch):
        return tried.result.T_a_b
    return before(estimate, tried)


def before(estimate: Estimate, tried: LoopCandidate) -> Array:
    """Where the front end had b in the frame of a."""
    return se2.between(estimate.submaps[tried.a].anchor, estimate.submaps[tried.b].anchor)


def partner(estimate: Estimate, tried: LoopCandidate) -> Walls:
    """The walls that b was stitched to, in the frame of a."""
    return merged(estimate, tried.b) if estimate.method in MERGING else piece(estimate, tried.a)
