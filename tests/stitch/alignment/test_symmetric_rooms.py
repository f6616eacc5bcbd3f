"""Rooms that look nearly the same turned: the right answer, or none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.align import NoStitch, align
from stitch.alignment.walls import surfaces

RESOLUTION, SIDE = 0.05, 240


def seen(corners: Array, T: Array, rng: np.random.Generator, noise: float) -> Submap:
    """A map ``T (3,)`` away of the room with these ``corners (n, 2)`` m, its walls with some m of noise."""
    corners = se2.transform(T, corners) / RESOLUTION + SIDE / 2
    free = cv2.fillPoly(np.zeros((SIDE, SIDE), np.uint8), [np.round(corners).astype(np.int32)], 1) > 0
    occupied = np.zeros_like(free)
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (q - p) / np.linalg.norm(q - p)
        off = rng.normal(0.0, noise / RESOLUTION, (400, 1)) * np.array([-along[1], along[0]])
        column, row = np.floor(p + np.linspace(0.0, 1.0, 400)[:, None] * (q - p) + off).astype(int).T
        occupied[row, column] = True
    grid = Grid(occupied, free & ~occupied, np.full(2, -0.5 * SIDE * RESOLUTION), RESOLUTION)
    return Submap(0, 1, np.zeros(3), surfaces(grid), grid)


def outcome(a: Submap, b: Submap, T_a_b: Array) -> str:
    answer = align(a, b)
    if isinstance(answer, NoStitch):
        return "ambiguous" if answer.reason.startswith("ambiguity") else "refused"
    error = np.abs(se2.between(T_a_b, answer.T_a_b))
    return "right" if np.all(error < [0.2, 0.2, 0.05]) else "false"


def square(rng: np.random.Generator) -> Array:
    """Corners ``(4, 2)`` m of a room that is square but for some decimetres."""
    side, off = rng.uniform(3.0, 7.0), rng.choice([0.0, 0.05, 0.1, 0.2, 0.4])
    return 0.5 * side * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]) + rng.normal(0.0, 1.0, (4, 2)) * off


def test_square_rooms_are_never_joined_falsely() -> None:
    """120 of them with themselves, as they are and drawn again in another frame."""
    outcomes = []
    for seed in range(120):
        rng = np.random.default_rng([120, seed])
        corners, noise = square(rng), rng.choice([0.0, 0.02])
        T = np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(-np.pi, np.pi)])
        a, b = (seen(corners, pose, rng, noise) for pose in (np.zeros(3), T))
        outcomes += [outcome(a, a, np.zeros(3)), outcome(a, b, se2.inverse(T))]
    assert outcomes.count("false") == 0
    assert outcomes.count("right") > 60  # odd ones are still told apart


@pytest.mark.parametrize("corners", [4, 6, 60])
def test_a_room_that_is_the_same_turned_is_ambiguous(corners: int) -> None:
    around = 2.0 * np.pi * np.arange(corners) / corners
    room = seen(
        3.0 * np.stack([np.cos(around), np.sin(around)], -1), np.zeros(3), np.random.default_rng(0), 0.0
    )
    assert outcome(room, room, np.zeros(3)) == "ambiguous"
