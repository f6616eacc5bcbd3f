"""OpenCV features on the grids as pictures: what ROS users merge maps with today.

As multirobot_map_merge does it: the detector's defaults, the nearest descriptor where it is clearly nearer
than the second, one transform for as many matches as possible, and no answer when too few agree. To the
features' advantage two things differ: the transform is rigid from the start, as grids of known resolution
have no scale, and fewer matches need to agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.published.pair import near, pair, redraw

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
"""Grey levels of map_server's pictures."""
MARGIN = 32
"""Unknown pixels around a map: detectors leave out what is near the border."""
ORB_FEATURES = 1500
RATIO = 0.7
"""Of the distances to the nearest and the second descriptor, from OpenCV's stitching (match_conf 0.3)."""
MOST_MATCHES = 500
PROPOSERS = 150
"""Matches, the most alike, whose pairs propose transforms; all matches vote (as Chum & Matas 2005)."""
REACH = 3.0
"""Pixels from its partner at which a match agrees with a transform: OpenCV's default."""
SHORTEST = 10.0
"""Pixels between two matches that may fix a rotation: 3 pixels of error are then 17°, before the refit."""
LEAST_CONFIDENCE = 0.5
"""Of ``agreeing / (8 + 0.3 matches)`` (Brown & Lowe 2007).

multirobot_map_merge asks for 1, which refuses most true answers at half overlap. On 300 pairs of drawn floor
plans (seeds 100–329) 19 of 20 false answers have less than 0.46."""


@dataclass(frozen=True)
class Matches:
    """Points ``a (n, 2)`` and ``b (n, 2)`` m whose descriptors are alike, most alike first."""

    a: Array
    b: Array


def align_features(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The rigid transform that most matches agree with; its score is their number. Without a covariance.

    There is no answer when `LEAST_CONFIDENCE` is not reached or the prior excludes what was found.
    """
    maps = pair(a, b, config)
    if isinstance(maps, NoStitch):
        return maps
    found = matches(a.grid, b.grid, config.method, config.resolution)
    if len(found.a) < 2:
        return NoStitch(f"{config.method}: {len(found.a)} matching features, expected at least 2")
    fitted = fit_rigid(found, REACH * config.resolution, SHORTEST * config.resolution)
    if fitted is None:
        return NoStitch(
            f"{config.method}: no two of {len(found.a)} matching features are as far apart in both"
        )
    T_a_b, agreeing = fitted
    best = Alternative(T_a_b, float(agreeing))
    least = LEAST_CONFIDENCE * (8.0 + 0.3 * len(found.a))
    if agreeing < least:
        return NoStitch(
            f"{config.method}: {agreeing} of {len(found.a)} matching features agree, "
            f"expected at least {least:.3g}",
            best,
        )
    if not near([best], prior):
        return NoStitch(f"{config.method}: the alignment is not near the prior", best)
    return maps.stitch(best, [])


def matches(grid_a: Grid, grid_b: Grid, method: str, resolution: float) -> Matches:
    """Features of both grids, drawn at ``resolution`` m, that match as seen from one of them at least."""
    import cv2

    points_a, descriptors_a = _features(grid_a, method, resolution)
    points_b, descriptors_b = _features(grid_b, method, resolution)
    if len(points_a) < 2 or len(points_b) < 2:
        return Matches(np.zeros((0, 2)), np.zeros((0, 2)))
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    found: dict[tuple[int, int], float] = {}
    for query, train, forward in (
        (descriptors_a, descriptors_b, True),
        (descriptors_b, descriptors_a, False),
    ):
        for first, second in matcher.knnMatch(query, train, k=2):
            if first.distance < RATIO * second.distance:
                indices = (first.queryIdx, first.trainIdx)
                found[indices if forward else indices[::-1]] = first.distance
    chosen = sorted(found, key=lambda indices: (found[indices], indices))[:MOST_MATCHES]
    rows = np.array(chosen, dtype=int).reshape(-1, 2)
    return Matches(points_a[rows[:, 0]], points_b[rows[:, 1]])


def _features(grid: Grid, method: str, resolution: float) -> tuple[Array, Any]:
    """Places ``(n, 2)`` m of a grid's features and their descriptors."""
    import cv2

    cells = redraw(grid, np.zeros(3), resolution)
    picture = np.full(cells.occupied.shape, UNKNOWN, dtype=np.uint8)
    picture[cells.free] = FREE
    picture[cells.occupied] = OCCUPIED
    picture = np.pad(picture, MARGIN, constant_values=UNKNOWN)
    if method == "akaze":
        keypoints, descriptors = cv2.AKAZE.create().detectAndCompute(picture, None)
        centre = np.full((len(keypoints), 1), 0.5)
    else:
        detector = cv2.ORB.create(nfeatures=ORB_FEATURES)
        keypoints, descriptors = detector.detectAndCompute(picture, None)
        # ORB multiplies the pixel of a smaller picture, not its centre: 1.3 pixels off at the smallest
        octaves = np.array([keypoint.octave for keypoint in keypoints]).reshape(-1, 1)
        centre = 0.5 * detector.getScaleFactor() ** octaves
    pixels = np.array([keypoint.pt for keypoint in keypoints]).reshape(-1, 2) + centre
    return (cells.first + pixels - MARGIN) * resolution, descriptors


def fit_rigid(found: Matches, reach: float, shortest: float) -> tuple[Array, int] | None:
    """Pose ``(3,)`` of b in a that most matches agree with to ``reach`` m, and how many do.

    Every two of the most alike that are as far apart in b as in a, and at least ``shortest`` m, propose one:
    nothing is drawn at random. The best is fitted to all that agree, as often as their number grows. None
    when no two matches will do.
    """
    first, second = np.triu_indices(min(len(found.a), PROPOSERS), 1)
    arm_a, arm_b = found.a[second] - found.a[first], found.b[second] - found.b[first]
    length_a, length_b = (np.hypot(arm[:, 0], arm[:, 1]) for arm in (arm_a, arm_b))
    use = (np.abs(length_a - length_b) <= reach) & (np.minimum(length_a, length_b) >= shortest)
    if not use.any():
        return None
    yaw = np.arctan2(arm_a[use, 1], arm_a[use, 0]) - np.arctan2(arm_b[use, 1], arm_b[use, 0])
    middle_a = 0.5 * (found.a[first] + found.a[second])[use]
    middle_b = 0.5 * (found.b[first] + found.b[second])[use]
    t = middle_a - np.einsum("kij,kj->ki", se2.rotation(yaw), middle_b)
    poses = np.column_stack([t, yaw])
    counts = np.concatenate(
        [_agree(found, part, reach).sum(axis=1) for part in np.array_split(poses, 1 + len(poses) // 1000)]
    )
    T_a_b, count = poses[int(np.argmax(counts))], int(counts.max())
    while True:
        agree = _agree(found, T_a_b[None], reach)[0]
        refitted = umeyama(found.a[agree], found.b[agree])
        grown = int(_agree(found, refitted[None], reach).sum())
        if grown < count:
            return se2.compose(np.zeros(3), T_a_b), count
        T_a_b = refitted
        if grown == count:
            return T_a_b, count
        count = grown


def _agree(found: Matches, T_a_b: Array, reach: float) -> np.ndarray:
    """Which matches ``(K, n)`` agree with poses ``(K, 3)``."""
    # as complex numbers: several times quicker than matrices two by two
    a, b = (points[:, 0] + 1j * points[:, 1] for points in (found.a, found.b))
    missed = np.exp(1j * T_a_b[:, 2:]) * b + (T_a_b[:, :1] + 1j * T_a_b[:, 1:2]) - a
    return missed.real**2 + missed.imag**2 <= reach**2


def umeyama(points_a: Array, points_b: Array) -> Array:
    """Pose ``(3,)`` with the least squared error of b's points ``(n, 2)`` on a's; no scale (Umeyama 1991)."""
    centre_a, centre_b = points_a.mean(axis=0), points_b.mean(axis=0)
    a, b = points_a - centre_a, points_b - centre_b
    yaw = np.arctan2(np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]), np.sum(b * a))
    return np.array([*(centre_a - se2.rotation(yaw) @ centre_b), yaw])
