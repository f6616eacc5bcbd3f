"""A bend: what a lattice does with points, its normal equations, and a known field that it finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam import se2
from stitch.alignment.bend import Bend, add_springs, bend, normal_equations, of_walls, settle, spring_energy
from stitch.alignment.config import TolerantConfig
from stitch.alignment.facing import facing_walls
from tests.stitch.alignment import bent_rooms

CONFIG = TolerantConfig()


def crooked() -> tuple[Bend, np.ndarray]:
    """A bent lattice and the rigid pose it was made from."""
    rng = np.random.default_rng(3)
    T = np.array([1.0, -2.0, 0.8])
    lattice = Bend(np.array([-4.0, -3.0]), 4.0, np.zeros((3, 4, 3))).moved_to(T)
    return replace(lattice, nodes=lattice.nodes + 0.1 * rng.standard_normal(lattice.nodes.shape)), T


def test_a_lattice_that_is_not_bent_moves_rigidly_also_beyond_itself() -> None:
    bent, T = crooked()
    points = np.random.default_rng(0).uniform(-20.0, 20.0, (50, 2))
    np.testing.assert_allclose(bent.moved_to(T).apply(points), se2.transform(T, points), atol=1e-9)
    assert bent.moved_to(T).energy(CONFIG) < 1e-12
    assert bent.moved_to(T).largest_displacement(T) < 1e-9


def test_knots_go_where_their_poses_are_and_undoing_leads_back() -> None:
    bent, T = crooked()
    knots = bent.places.reshape(-1, 2)
    np.testing.assert_allclose(bent.apply(knots), bent.nodes[..., :2].reshape(-1, 2), atol=1e-9)
    points = np.random.default_rng(1).uniform(-3.0, 4.0, (50, 2))
    np.testing.assert_allclose(bent.undo(bent.apply(points), T), points, atol=1e-3)


def test_a_bend_between_anchors_is_the_same_between_maps() -> None:
    bent, _ = crooked()
    anchor_a, anchor_b = np.array([3.0, 1.0, -0.4]), np.array([-2.0, 5.0, 1.1])
    points = np.random.default_rng(2).uniform(-3.0, 4.0, (20, 2))
    between_maps = bent.between_maps(anchor_a, anchor_b)
    expected = se2.transform(anchor_a, bent.apply(points))
    np.testing.assert_allclose(between_maps.apply(se2.transform(anchor_b, points)), expected, atol=1e-9)


def test_a_fold_is_seen() -> None:
    bent, _ = crooked()
    middle = bent.places[:-1, :-1].reshape(-1, 2) + 2.0
    assert bent.least_jacobian(middle) > 0.5
    nodes = bent.nodes.copy()
    nodes[:, [1, 2]] = nodes[:, [2, 1]]
    assert replace(bent, nodes=nodes).least_jacobian(middle) < 0.0


def test_springs_pull_along_the_gradient_of_their_energy() -> None:
    bent, _ = crooked()
    columns, size = bent.nodes.shape[1], bent.nodes.size
    A, g = np.zeros((3 * (columns + 2), size)), np.zeros(size)
    add_springs(A, g, bent.nodes, bent.spacing, 25.0, 500.0)
    numeric = np.zeros(size)
    for k in range(size):
        step = np.zeros(size)
        step[k] = 1e-6
        up, down = (
            spring_energy(bent.nodes + sign * step.reshape(bent.nodes.shape), bent.spacing, 25.0, 500.0)
            for sign in (1.0, -1.0)
        )
        numeric[k] = (up - down) / 2e-6
    np.testing.assert_allclose(-g, numeric, rtol=1e-4, atol=1e-3)


def test_walls_do_not_pull_where_they_lie_on_each_other() -> None:
    walls = facing_walls(bent_rooms.pair()[0], CONFIG.unknown_weight)
    lattice = Bend.rigid(walls, np.zeros(3), 4.0)
    _, g = normal_equations(
        lattice.nodes, lattice.first, lattice.spacing, 0.35, walls.points, walls.angles, walls.known,
        walls.weights, *of_walls(walls),
    )  # fmt: skip
    moved = lattice.moved_to(np.array([0.1, 0.0, 0.0]))
    _, pull = normal_equations(
        moved.nodes, moved.first, moved.spacing, 0.35, walls.points, walls.angles, walls.known,
        walls.weights, *of_walls(walls),
    )  # fmt: skip
    assert np.abs(g).max() < 0.05 * np.abs(pull).max()
    assert pull.reshape(-1, 3)[:, 0].sum() < 0.0


def test_a_known_field_is_found() -> None:
    a, b = (facing_walls(submap, CONFIG.unknown_weight) for submap in bent_rooms.pair())
    start = se2.compose(bent_rooms.T_A_B, [0.4, -0.3, 0.02])
    rigid = settle(a, b, start, CONFIG)
    bent = bend(a, b, rigid, CONFIG)
    shared = b.points[bent_rooms.true_places(b.points)[:, 0] < 20.0]
    truth = bent_rooms.true_places(shared)
    before, after = (
        np.mean(np.linalg.norm(places - truth, axis=1))
        for places in (se2.transform(rigid, shared), bent.apply(shared))
    )
    assert after < 0.12
    assert after < 0.5 * before
    assert bent.least_jacobian(b.points) > 0.5
