"""Candidates of an alignment: those that are near a better one are the same answer."""

from __future__ import annotations

import math

from slam import se2
from slam.se2 import Array


def distinct(
    poses: Array, centre: Array, separation: tuple[float, float], most: int | None = None
) -> list[int]:
    """Rows of the first ``most`` of ``poses (n, 3)``, best first, without those near a better one.

    Near is what lies within both of ``separation`` (m at b's ``centre (2,)``, rad).
    """
    centres = se2.transform(poses, centre[None])[:, 0].tolist()
    yaws = poses[:, 2].tolist()
    shift, turn = separation

    def apart(i: int, k: int) -> bool:  # of plain numbers, which numpy is slow with
        turned = abs((yaws[k] - yaws[i] + math.pi) % (2.0 * math.pi) - math.pi)
        return math.dist(centres[k], centres[i]) > shift or turned > turn

    kept: list[int] = []
    for i in range(len(poses)):
        if len(kept) == most:
            break
        if all(apart(i, k) for k in kept):
            kept.append(i)
    return kept
