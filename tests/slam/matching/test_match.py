"""Scan matching: known answers, settings, and what is no answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from slam import se2
from slam.matching import RAW_WSM, Bias, Match, MatchConfig, NoMatch, Reference, match
from slam.scan import Scan
from slam.se2 import Array

METHODS = ("wsm", "icp", "plicp")
FROM = np.array([2.0, 2.5, 0.3])
MOVED = np.array([0.15, -0.08, 0.06])
SEED_ERROR = np.array([0.03, -0.03, np.radians(1.1)])
ONE_LEVEL = MatchConfig(levels=((0.5, 1),), search_shift=0.0)

Look = Callable[..., Scan]


def pair(look: Look, walls: Array, seed: int = 0) -> tuple[Scan, Scan]:
    """Noisy scans from `FROM` and from `MOVED` seen from there."""
    rng = np.random.default_rng(seed)
    return look(walls, FROM, rng), look(walls, se2.compose(FROM, MOVED), rng)


def found(*arguments: object, **settings: object) -> Match:
    result = match(*arguments, **settings)  # type: ignore[arg-type]
    assert isinstance(result, Match), result
    return result


# Known answers


@pytest.mark.parametrize("method", METHODS)
def test_the_same_points_give_the_exact_pose(room: Array, look: Look, method: str) -> None:
    scan = look(room, FROM)
    reference = scan.transformed(MOVED)
    # Seeded so near that every point's nearest neighbour is its own copy.
    result = found(reference, scan, MOVED + 0.1 * SEED_ERROR, method)
    np.testing.assert_allclose(result.T_reference_scan, MOVED, atol=1e-5)
    assert result.converged
    assert result.residual_rms < 1e-3


@pytest.mark.parametrize(("method", "tolerance"), [("wsm", 0.006), ("plicp", 0.006), ("icp", 0.04)])
def test_another_look_at_the_room_gives_the_pose(
    room: Array, look: Look, method: str, tolerance: float
) -> None:
    reference, scan = pair(look, room)
    result = found(reference, scan, MOVED + SEED_ERROR, method)
    np.testing.assert_allclose(result.T_reference_scan, MOVED, atol=tolerance)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("frame", [[3.0, -2.0, 0.0], [10.0, 5.0, 2.5], [0.0, 0.0, np.pi]])
def test_the_frame_of_the_reference_does_not_matter(
    room: Array, look: Look, method: str, frame: list[float]
) -> None:
    reference, scan = pair(look, room)
    T_map_reference = np.array(frame)
    guess = MOVED + SEED_ERROR
    here = found(reference, scan, guess, method)
    there = found(reference.transformed(T_map_reference), scan, se2.compose(T_map_reference, guess), method)
    expected = se2.compose(T_map_reference, here.T_reference_scan)
    np.testing.assert_allclose(se2.log(se2.between(expected, there.T_reference_scan)), 0.0, atol=2e-3)
    # The covariance is of the scan's own axes, so it does not turn with the frame.
    np.testing.assert_allclose(there.covariance, here.covariance, rtol=0.1, atol=1e-7)


def test_a_reference_may_be_built_once(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    once = found(reference, scan, MOVED)
    again = found(Reference(reference), Reference(scan), MOVED)
    np.testing.assert_array_equal(again.T_reference_scan, once.T_reference_scan)
    np.testing.assert_array_equal(again.covariance, once.covariance)


def test_the_yaw_comes_back_wrapped(room: Array, look: Look) -> None:
    scan = look(room, FROM)
    turn = np.array([0.0, 0.0, 3.1])
    result = found(scan.transformed(turn), scan, turn + np.array([0.0, 0.0, 2.0 * np.pi]))
    np.testing.assert_allclose(result.T_reference_scan, turn, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("covariance", ["joint", "p2l"])
def test_what_a_match_carries(room: Array, look: Look, method: str, covariance: str) -> None:
    reference, scan = pair(look, room)
    result = found(reference, scan, MOVED, method, covariance)
    P = result.covariance
    np.testing.assert_allclose(P, P.T, atol=1e-15)
    assert np.all(np.linalg.eigvalsh(P) > 0.0)
    assert np.all(np.linalg.eigvalsh(P) <= 1.0 + 1e-9)
    assert np.all(np.diff(result.information_eigenvalues) >= 0.0)
    assert 100 < result.n_matches <= len(scan)
    assert result.iterations <= 50


def test_residuals_are_what_the_covariances_expect(room: Array, look: Look) -> None:
    rms = [found(*pair(look, room, seed), MOVED, "wsm").residual_rms for seed in range(10)]
    # About 1 if nearest neighbours were random and points not drawn to their neighbours' line; they are.
    assert 0.35 < np.mean(rms) < 1.1


# Nothing is a value


def test_no_match_says_why(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    far = match(reference, scan, np.array([50.0, 0.0, 0.0]))
    assert isinstance(far, NoMatch)
    assert far.n_matches == 0
    assert "0 pairs within 0.1 m" in far.reason
    few = match(reference, scan, MOVED, config=MatchConfig(least_pairs=1000))
    assert isinstance(few, NoMatch)
    assert few.n_matches > 100
    blind = scan.selected(np.zeros(len(scan), dtype=bool))
    for a, b in ((reference, blind), (blind, scan), (blind, blind)):
        assert match(a, b, MOVED) == NoMatch("a scan has no points")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"guess": [0.0, 0.0]}, "guess"),
        ({"guess": [0.0, np.nan, 0.0]}, "guess"),
        ({"method": "gicp"}, "method"),
        ({"covariance": "hessian"}, "covariance"),
    ],
)
def test_wrong_arguments_are_named(room: Array, look: Look, arguments: dict[str, object], named: str) -> None:
    scan = look(room, FROM)
    with pytest.raises(ValueError, match=f"^{named}: expected"):
        match(scan, scan, **{"guess": np.zeros(3), **arguments})  # type: ignore[arg-type]


# Settings


def test_weak_directions_stay_at_the_guess(corridor: Array, look: Look) -> None:
    rng = np.random.default_rng(3)
    reference, scan = (look(corridor, np.array([x, 0.1, 0.0]), rng) for x in (0.0, 0.1))
    guess = np.array([0.35, 0.02, 0.01])
    faded = found(reference, scan, guess, "plicp", config=MatchConfig(fade=0.02, search_shift=0.0))
    assert faded.T_reference_scan[0] == pytest.approx(guess[0], abs=0.01)
    np.testing.assert_allclose(faded.T_reference_scan[1:], 0.0, atol=0.005)
    assert faded.information[0, 0] < 1e-2 * faded.information[1, 1]


def test_a_prior_decides_where_the_walls_do_not(corridor: Array, room: Array, look: Look) -> None:
    prior = np.diag([1e4, 1e4, 1e4])
    rng = np.random.default_rng(4)
    reference, scan = (look(corridor, np.array([x, 0.0, 0.0]), rng) for x in (0.0, 0.1))
    guess = np.array([0.1, 0.03, 0.0])
    result = found(
        reference,
        scan,
        guess,
        "plicp",
        prior_information=prior,
        config=MatchConfig(fade=0.02, search_shift=0.0),
    )
    assert result.T_reference_scan[0] == pytest.approx(0.1, abs=0.005)
    assert abs(result.T_reference_scan[1]) < 0.01
    assert np.sqrt(result.covariance[0, 0]) == pytest.approx(0.01, rel=0.2)
    # Overwhelming, it is the answer; as strong as the match, it pulls half of the way.
    overwhelming = found(*pair(look, room), MOVED + SEED_ERROR, prior_information=1e10 * np.eye(3))
    np.testing.assert_allclose(overwhelming.T_reference_scan, MOVED + SEED_ERROR, atol=1e-4)


def test_a_prior_and_a_match_meet_by_their_weights(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    config = MatchConfig(robust=1e12)
    alone = found(reference, scan, MOVED, "plicp", config=config)
    offset = np.array([0.006, -0.004, 0.002])
    guess = alone.T_reference_scan + offset
    both = found(reference, scan, guess, "plicp", prior_information=alone.information, config=config)
    np.testing.assert_allclose(both.T_reference_scan - alone.T_reference_scan, 0.5 * offset, atol=5e-4)
    np.testing.assert_allclose(both.covariance, 0.5 * alone.covariance, rtol=0.1, atol=2e-7)


def test_robust_weights_resist_a_moved_cupboard(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    points = scan.points.copy()
    points[20:45] += [0.2, 0.1]
    moved = Scan(points, scan.tangents, scan.normals, scan.covariance, scan.tangent_sigma, scan.beams)
    error = {
        robust: np.linalg.norm(
            found(reference, moved, MOVED, config=replace(ONE_LEVEL, robust=robust)).T_reference_scan[:2]
            - MOVED[:2]
        )
        for robust in (9.0, 1e12)
    }
    assert error[9.0] < 0.01
    assert error[9.0] < 0.5 * error[1e12]


def faces_of_a_thin_wall(look: Look) -> tuple[Scan, Scan]:
    """Scans of a wall from below and from above, both in one frame."""
    wall = np.array([[-3.0, 0.0, 3.0, 0.0]])
    below, above = np.array([0.0, -1.0, np.pi / 2]), np.array([0.0, 1.0, -np.pi / 2])
    return look(wall, below).transformed(below), look(wall, above).transformed(above)


def test_both_faces_of_a_thin_wall_are_different_surfaces(look: Look) -> None:
    below, above = faces_of_a_thin_wall(look)
    assert isinstance(match(below, above, np.zeros(3), "plicp"), NoMatch)
    assert isinstance(match(below, below, np.zeros(3), "plicp"), Match)


def test_the_alternating_solution_finds_the_same_pose(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    joint = found(reference, scan, MOVED + SEED_ERROR, "wsm", config=replace(RAW_WSM, solver="joint"))
    alternating = found(reference, scan, MOVED + SEED_ERROR, "wsm", "pfister_block", config=RAW_WSM)
    np.testing.assert_allclose(alternating.T_reference_scan, joint.T_reference_scan, atol=1.5e-3)
    assert alternating.converged
    assert 8 <= alternating.iterations < 80


def test_the_alternating_solution_is_exact_in_a_few_steps_when_the_pairs_are(look: Look, room: Array) -> None:
    scan = look(room, FROM)
    config = replace(RAW_WSM, most_iterations=5)
    result = found(scan.transformed(MOVED), scan, MOVED + 0.1 * SEED_ERROR, "wsm", "joint", config=config)
    np.testing.assert_allclose(result.T_reference_scan, MOVED, atol=1e-6)


def test_another_sensors_bias_is_taken_off(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    ranges = np.linalg.norm(scan.points, axis=1, keepdims=True)
    longer = replace(scan, points=scan.points * (1.0 + 0.06 / ranges))
    as_it_is = found(reference, longer, MOVED, "plicp")
    bias = Bias.of_range(longer, mean=0.06, sigma=0.02)
    corrected = found(reference, longer, MOVED, "plicp", bias=bias)
    np.testing.assert_allclose(corrected.T_reference_scan, MOVED, atol=0.005)
    assert np.linalg.norm(as_it_is.T_reference_scan[:2] - MOVED[:2]) > 0.02
    # The bias is uncertain, so the answer is.
    known = found(reference, longer, MOVED, "plicp", bias=Bias.of_range(longer, mean=0.06, sigma=0.0))
    assert np.trace(corrected.covariance) > 1.5 * np.trace(known.covariance)
    with pytest.raises(ValueError, match=r"^bias: expected"):
        match(reference, longer, MOVED, bias=Bias(np.zeros(3), np.zeros((2, 2))))


def test_levels_are_checked() -> None:
    for levels in ((), ((0.0, 1),), ((0.5, 0),)):
        with pytest.raises(ValueError, match=r"^levels: expected"):
            MatchConfig(levels=levels)
    with pytest.raises(ValueError, match=r"^solver: expected"):
        MatchConfig(solver="newton")  # type: ignore[arg-type]


# Every setting changes the answer: name -> (scene, a value that is not the default)

CHANGED: dict[str, tuple[str, object]] = {
    "levels": ("room", ((0.1, 1),)),
    "robust": ("room", 1.0),
    "mutual": ("room", True),
    "oriented": ("thin wall", False),
    "same_side": ("thin wall", -2.0),
    "fade": ("corridor", 0.5),
    "freeze_ratio": ("room", 0.9),
    "most_iterations": ("room", 1),
    "last_step": ("room", 1e-1),
    "converged_step": ("room", 1e-9),
    "coarse_step": ("room", 1.0),
    "least_pairs": ("few", 3),
    "sigma": ("icp", 0.1),
    "length": ("room", 50.0),
    "least_information": ("corridor", 5.0),
    "solver": ("room", "alternating"),
    "misfit_cap": ("room", 1.0),
    "search_shift": ("searched", 0.3),
    "search_turn": ("searched", 0.1),
    "prior_sigmas": ("prior", 0.4),
    "least_share": ("unsure", 1.1),
    "most_misfit": ("unsure", 0.0),
    "open_direction": ("corridor", -1e9),
    "margin": ("searched", -1e9),
    "correlated_points": ("corridor", 1e3),
    "search_cell": ("searched", 0.2),
    "search_angle": ("searched", np.radians(5.0)),
    "search_range": ("searched", 1.0),
    "search_spacing": ("searched", 2.0),
    "search_points": ("searched", 5),
    "candidates": ("searched", 1),
    "apart_cells": ("searched", 6),
    "apart_angles": ("searched", 15),
    "open_step": ("corridor", 0.15),
    "open_steps": ("corridor", 1),
    "same_scan": ("again", 0.0),
}


SEARCHED = {"least_share": 2.0, "correlated_points": 1e3}
"""Settings that make every match look elsewhere, and tell of all it finds by its covariance."""


def look_at(scene: str, room: Array, corridor: Array, look: Look, **settings: object) -> Match | NoMatch:
    """A match in one of the scenes that `CHANGED` names."""
    rng = np.random.default_rng(3)
    config = replace(MatchConfig(), **{**(SEARCHED if scene in ("searched", "prior") else {}), **settings})  # type: ignore[arg-type]
    if scene in ("corridor", "again"):
        reference = look(corridor, np.zeros(3), rng)
        scan = reference if scene == "again" else look(corridor, np.array([0.1, 0.0, 0.0]), rng)
        return match(reference, scan, np.array([0.3, 0.05, 0.1]), config=config)
    if scene == "thin wall":
        return match(*faces_of_a_thin_wall(look), np.zeros(3), config=config)
    reference, scan = pair(look, room)
    if scene == "few":
        return match(reference, scan.selected(np.arange(0, len(scan), 25)), MOVED, config=config)
    if scene in ("searched", "prior"):
        prior = None if scene == "searched" else np.diag([4.0, 4.0, 16.0])
        guess = MOVED + np.array([-0.5, -0.4, -0.45])
        return match(reference, scan, guess, prior_information=prior, config=config)
    return match(reference, scan, MOVED + SEED_ERROR, "icp" if scene == "icp" else "plicp", config=config)


@pytest.mark.parametrize("name", [field.name for field in fields(MatchConfig)])
def test_every_setting_changes_the_answer(room: Array, corridor: Array, look: Look, name: str) -> None:
    scene, value = CHANGED[name]
    plain = look_at(scene, room, corridor, look)
    changed = look_at(scene, room, corridor, look, **{name: value})
    assert isinstance(changed, Match)
    if scene in ("few", "thin wall"):  # the default refuses, the change is what finds an answer
        assert isinstance(plain, NoMatch)
        return
    assert isinstance(plain, Match)
    answers = [
        [*m.T_reference_scan, *m.covariance.ravel(), m.misfit, m.converged, m.tried] for m in (plain, changed)
    ]
    assert not np.allclose(*answers, rtol=1e-6, atol=0.0), name
