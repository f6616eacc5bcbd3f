"""OpenCV features on the grids as pictures: what ROS users merge maps with today.

As in multirobot_map_merge: the detector's defaults, the nearest descriptor where clearly nearer than the
second, one transform for as many matches as possible. In the features' favour it is rigid from the start, and
fewer matches need to agree.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slam import se2
from slam.formats.ros_map import FREE, OCCUPIED, UNKNOWN
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.published.carpin import redraw
from stitch.published.pair import Pair, near


def align_features(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The rigid transform that most matches agree with; its score is their number. Without a covariance.

    There is no answer when too few of the matches agree or the prior excludes what was found.
    """
    points_a, points_b = match_features(a.grid, b.grid, config)
    count, method = len(points_a), config.method
    if count < 2:
        return NoStitch(f"{method}: {count} matching features, expected at least 2")
    fitted = fit_rigid(points_a, points_b, config)
    if fitted is None:
        return NoStitch(f"{method}: no two of {count} matching features are as far apart in both")
    T_a_b, agreeing = fitted
    best = Alternative(T_a_b, float(agreeing))
    least = config.features.min_confidence * (8.0 + 0.3 * count)
    if agreeing < least:
        reason = f"{method}: {agreeing} of {count} matching features agree, expected at least {least:.3g}"
        return NoStitch(reason, best)
    if not near([best], prior, config):
        return NoStitch(f"{method}: the alignment is not near the prior", best)
    return Pair(a, b, config).stitch(best, [])


def match_features(grid_a: Grid, grid_b: Grid, config: AlignConfig) -> tuple[Array, Array]:
    """Points ``(n, 2)`` m of either grid, drawn at ``config.resolution``, whose features match as seen from
    one of them, the most alike first."""
    import cv2

    points_a, descriptors_a = _features(grid_a, config)
    points_b, descriptors_b = _features(grid_b, config)
    if len(points_a) < 2 or len(points_b) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    distance: dict[tuple[int, int], float] = {}
    for query, train, order in ((descriptors_a, descriptors_b, 1), (descriptors_b, descriptors_a, -1)):
        for first, second in matcher.knnMatch(query, train, k=2):
            if first.distance < config.features.ratio * second.distance:
                row_a, row_b = (first.queryIdx, first.trainIdx)[::order]
                distance[row_a, row_b] = first.distance
    chosen = sorted(distance, key=lambda rows: (distance[rows], rows))[: config.features.max_matches]
    rows = np.array(chosen, dtype=int).reshape(-1, 2)
    return points_a[rows[:, 0]], points_b[rows[:, 1]]


def _features(grid: Grid, config: AlignConfig) -> tuple[Array, Any]:
    """Places ``(n, 2)`` m of a grid's features and their descriptors."""
    import cv2

    cells, margin = redraw(grid, np.zeros(3), config.resolution), config.features.margin
    picture = np.full(cells.occupied.shape, UNKNOWN, dtype=np.uint8)
    picture[cells.free] = FREE
    picture[cells.occupied] = OCCUPIED
    picture = np.pad(picture, margin, constant_values=UNKNOWN)
    if config.method == "akaze":
        keypoints, descriptors = cv2.AKAZE.create().detectAndCompute(picture, None)
        centre = np.full((len(keypoints), 1), 0.5)
    else:
        detector = cv2.ORB.create(nfeatures=config.features.orb_features)
        keypoints, descriptors = detector.detectAndCompute(picture, None)
        # ORB multiplies the pixel of a smaller picture, not its centre: 1.3 pixels off at the smallest
        octaves = np.array([keypoint.octave for keypoint in keypoints]).reshape(-1, 1)
        centre = 0.5 * detector.getScaleFactor() ** octaves
    pixels = np.array([keypoint.pt for keypoint in keypoints]).reshape(-1, 2) + centre
    return (cells.first + pixels - margin) * config.resolution, descriptors


def fit_rigid(a: Array, b: Array, config: AlignConfig) -> tuple[Array, int] | None:
    """Pose ``(3,)`` of b in a that most matches ``a (n, 2)``, ``b (n, 2)``, the most alike first, agree with,
    and how many do; None when no two will do.

    Every two of the most alike that are as far apart in b as in a, and far enough, propose a pose: nothing is
    drawn at random. The best is fitted to all that agree, again as long as their number grows.
    """
    reach, min_arm = config.features.reach * config.resolution, config.features.min_arm * config.resolution
    first, second = np.triu_indices(min(len(a), config.features.proposers), 1)
    arm_a, arm_b = a[second] - a[first], b[second] - b[first]
    length_a, length_b = (np.hypot(arm[:, 0], arm[:, 1]) for arm in (arm_a, arm_b))
    use = (np.abs(length_a - length_b) <= reach) & (np.minimum(length_a, length_b) >= min_arm)
    if not use.any():
        return None
    yaw = np.arctan2(arm_a[use, 1], arm_a[use, 0]) - np.arctan2(arm_b[use, 1], arm_b[use, 0])
    middle_a = 0.5 * (a[first] + a[second])[use]
    middle_b = 0.5 * (b[first] + b[second])[use]
    t = middle_a - np.einsum("kij,kj->ki", se2.rotation(yaw), middle_b)
    poses = np.column_stack([t, yaw])
    counts = np.concatenate(
        [_agree(a, b, part, reach).sum(axis=1) for part in np.array_split(poses, 1 + len(poses) // 1000)]
    )
    T_a_b, count = poses[int(np.argmax(counts))], int(counts.max())
    while True:
        agree = _agree(a, b, T_a_b[None], reach)[0]
        refitted = se2.fit_rigid(b[agree], a[agree])
        grown = int(_agree(a, b, refitted[None], reach).sum())
        if grown < count:
            return se2.compose(np.zeros(3), T_a_b), count
        T_a_b = refitted
        if grown == count:
            return T_a_b, count
        count = grown


def _agree(points_a: Array, points_b: Array, T_a_b: Array, reach: float) -> np.ndarray:
    """Which matches ``(K, n)`` agree with poses ``(K, 3)``."""
    # as complex numbers: several times quicker than matrices two by two
    a, b = (points[:, 0] + 1j * points[:, 1] for points in (points_a, points_b))
    missed = np.exp(1j * T_a_b[:, 2:]) * b + (T_a_b[:, :1] + 1j * T_a_b[:, 1:2]) - a
    return missed.real**2 + missed.imag**2 <= reach**2
