"""Registration by others, where it is installed: to compare only."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import numpy as np

from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch

KISS = "kiss"
"""KISS-Matcher (Lim et al. 2025): Faster-PFH features, k-core pruning, graduated non-convexity."""
VOXEL = 0.3
"""Its voxels [m], its own default."""
HEIGHTS = np.arange(0.0, 2.01, 0.4)
"""Heights [m] at which walls are repeated: it expects a cloud in space."""
LEAST = 10
"""Inliers below which its answer is refused: what it says itself accepts everything."""


def is_installed() -> bool:
    """Whether KISS-Matcher can be asked."""
    return find_spec("kiss_matcher") is not None


def align_kiss(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """Its answer for the walls of two maps, standing upright; without covariance, and without the prior."""
    kiss = import_module("kiss_matcher")
    matcher = kiss.KISSMatcher(kiss.KISSMatcherConfig(VOXEL, use_quatro=True))
    found = matcher.estimate(upright(b.points.points), upright(a.points.points))
    R, t = np.array(found.rotation), np.array(found.translation).ravel()
    T_a_b, inliers = np.array([t[0], t[1], np.arctan2(R[1, 0], R[0, 0])]), matcher.get_num_final_inliers()
    if inliers < LEAST:
        return NoStitch(f"{inliers} inliers, expected at least {LEAST}", Alternative(T_a_b, float(inliers)))
    return Stitch(T_a_b, None, float(inliers), np.nan, np.nan)


def upright(points: Array) -> list[Array]:
    """Wall points ``(n, 2)`` m as a cloud of points ``(3,)``, at all `HEIGHTS`."""
    cloud = np.concatenate([np.column_stack([points, np.full(len(points), z)]) for z in HEIGHTS])
    return list(cloud.astype(np.float32))
