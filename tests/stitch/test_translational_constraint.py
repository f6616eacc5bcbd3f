"""How well shared walls constrain a translation; beside the drawn maps that it needs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scenarios.ablate.pair_sampling import translational_constraint
from slam.mapping.submap import Submap


@pytest.fixture(scope="module")
def corridor(plan: dict[str, Any]) -> tuple[Submap, Submap]:
    """Ten metres of two walls, and the same with an end wall of 2 m; both in one frame."""
    rng = np.random.default_rng(0)
    sides = np.array([[-40.0, 0.0, 40.0, 0.0], [-40.0, 2.0, 40.0, 2.0]])
    end = np.array([[5.0, 0.0, 5.0, 2.0]])
    poses = np.column_stack([np.linspace(-4.0, 4.0, 30), np.full(30, 1.0), rng.uniform(-3.0, 3.0, 30)])
    frame = np.array([0.0, 1.0, 0.4])
    return plan["see"](sides, poses, frame, rng), plan["see"](np.vstack([sides, end]), poses, frame, rng)


def test_a_bare_corridor_constrains_nothing_along_it(corridor: tuple[Submap, Submap]) -> None:
    assert translational_constraint(corridor[0], corridor[0], np.zeros(3)) < 0.2


def test_an_end_wall_constrains_by_its_length(corridor: tuple[Submap, Submap]) -> None:
    """A wall that is seen with noise fills some cells twice."""
    assert 1.5 < translational_constraint(corridor[1], corridor[1], np.zeros(3)) < 3.0


def test_walls_that_do_not_meet_constrain_nothing(corridor: tuple[Submap, Submap]) -> None:
    assert translational_constraint(corridor[1], corridor[1], np.array([200.0, 0.0, 0.0])) == 0.0
