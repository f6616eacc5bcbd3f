"""Scan matching: known answers, slow twins of the kernels, and whether its covariances tell the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slam import se2
from slam.matching import Match, MatchConfig, NoMatch, Reference, kernels, match
from slam.scan import Scan
from slam.se2 import Array

METHODS = ("wsm", "icp", "plicp")
FROM = np.array([2.0, 2.5, 0.3])
MOVED = np.array([0.15, -0.08, 0.06])
SEED_ERROR = np.array([0.03, -0.03, np.radians(1.1)])

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
    # About 1 if nearest neighbours were random; they are the nearest, so a little less.
    assert 0.5 < np.mean(rms) < 1.1


# Nothing is a value


def test_no_match_says_why(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    far = match(reference, scan, np.array([50.0, 0.0, 0.0]))
    assert isinstance(far, NoMatch)
    assert far.n_matches == 0
    assert "0 pairs within 0.3 m" in far.reason
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
    faded = found(reference, scan, guess, "plicp", config=MatchConfig(fade=0.02))
    assert faded.T_reference_scan[0] == pytest.approx(guess[0], abs=0.01)
    np.testing.assert_allclose(faded.T_reference_scan[1:], 0.0, atol=0.005)
    assert faded.information[0, 0] < 1e-2 * faded.information[1, 1]


def test_a_prior_decides_where_the_walls_do_not(corridor: Array, room: Array, look: Look) -> None:
    prior = np.diag([1e4, 1e4, 1e4])
    rng = np.random.default_rng(4)
    reference, scan = (look(corridor, np.array([x, 0.0, 0.0]), rng) for x in (0.0, 0.1))
    guess = np.array([0.1, 0.03, 0.0])
    result = found(reference, scan, guess, "plicp", prior_information=prior, config=MatchConfig(fade=0.02))
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
            found(reference, moved, MOVED, config=MatchConfig(robust=robust)).T_reference_scan[:2] - MOVED[:2]
        )
        for robust in (9.0, 1e12)
    }
    assert error[9.0] < 0.01
    assert error[9.0] < 0.5 * error[1e12]


def test_both_faces_of_a_thin_wall_are_different_surfaces(look: Look) -> None:
    wall = np.array([[-3.0, 0.0, 3.0, 0.0]])
    below = look(wall, np.array([0.0, -1.0, np.pi / 2])).transformed(np.array([0.0, -1.0, np.pi / 2]))
    above = look(wall, np.array([0.0, 1.0, -np.pi / 2])).transformed(np.array([0.0, 1.0, -np.pi / 2]))
    assert isinstance(match(below, above, np.zeros(3), "plicp"), NoMatch)
    assert isinstance(match(below, below, np.zeros(3), "plicp"), Match)


# Honesty (calibration)


@dataclass(frozen=True)
class Trials:
    """Errors ``(M, 3)`` and predicted covariances ``(M, 3, 3)``, both in the body frame of the scan."""

    errors: Array
    covariances: Array

    @property
    def anees(self) -> float:
        solved = np.linalg.solve(self.covariances, self.errors[..., None])[..., 0]
        return float(np.mean(np.sum(self.errors * solved, axis=1)) / 3.0)

    @property
    def sd(self) -> Array:
        """Median predicted standard deviations ``(3,)``."""
        return np.sqrt(np.median(np.diagonal(self.covariances, axis1=1, axis2=2), axis=0))


def trials(look: Look, walls: Array, start: Array, method: str, covariance: str, count: int = 150) -> Trials:
    """Matches of scans from random places near ``start``, seeded 3 cm and 1.1° off the truth."""
    rng = np.random.default_rng(5)
    errors, covariances = [], []
    for _ in range(count):
        pose = start + rng.uniform(-0.3, 0.3, 3) * [1.0, 1.0, 0.3]
        T = rng.uniform(-1.0, 1.0, 3) * [0.2, 0.0, 0.08] + [0.1, 0.0, 0.0]
        reference, scan = look(walls, pose, rng), look(walls, se2.compose(pose, T), rng)
        guess = T + rng.normal(size=3) * np.abs(SEED_ERROR)
        config = MatchConfig(radii=(0.5,), most_iterations=80, robust=1e12 if method == "icp" else 9.0)
        result = found(reference, scan, guess, method, covariance, config=config)
        errors.append(se2.log(se2.between(result.T_reference_scan, T)))
        covariances.append(result.covariance)
    return Trials(np.array(errors), np.array(covariances))


@pytest.mark.parametrize(
    ("method", "covariance"), [("wsm", "joint"), ("wsm", "p2l"), ("plicp", "p2l"), ("plicp", "joint")]
)
def test_in_a_room_weighted_covariances_are_honest(
    room: Array, look: Look, method: str, covariance: str
) -> None:
    result = trials(look, room, FROM, method, covariance)
    rms = np.sqrt(np.mean(result.errors**2, axis=0))
    assert np.all(rms < [0.0030, 0.0030, 0.0010])
    # The 95 % band of 150 Gaussian trials is 0.87 .. 1.14; corners give the errors somewhat heavier tails.
    assert 0.75 < result.anees < 1.35
    np.testing.assert_allclose(result.sd, rms, rtol=0.4)


def test_in_a_room_unweighted_icp_is_overconfident(room: Array, look: Look) -> None:
    result = trials(look, room, FROM, "icp", "joint", count=80)
    assert result.anees > 10.0
    assert np.sqrt(np.mean(result.errors[:, :2] ** 2)) > 0.006


def test_in_a_corridor_only_walls_normals_tell_that_the_way_along_is_unknown(
    corridor: Array, look: Look
) -> None:
    joint = trials(look, corridor, np.zeros(3), "wsm", "joint", count=80)
    honest = trials(look, corridor, np.zeros(3), "wsm", "p2l", count=80)
    np.testing.assert_array_equal(joint.errors, honest.errors)
    along = np.sqrt(np.mean(joint.errors[:, 0] ** 2))
    assert along > 0.02
    assert joint.sd[0] < 0.2 * along
    assert joint.anees > 20.0
    assert honest.sd[0] >= 0.3
    assert honest.sd[2] < 0.003
    assert 0.3 < honest.anees < 1.3


def test_the_unknown_direction_is_one_of_the_body(corridor: Array, look: Look) -> None:
    around = np.radians(np.arange(-180.0, 180.0, 2.0))
    rng = np.random.default_rng(6)
    reference, along = (look(corridor, np.array([x, 0.0, 0.0]), rng, around) for x in (0.0, 0.05))
    across = look(corridor, np.array([0.05, 0.0, np.pi / 2]), rng, around)
    sd = {
        name: np.sqrt(np.diag(found(reference, scan, np.array([0.05, 0.0, yaw]), "wsm", "p2l").covariance))
        for name, scan, yaw in (("along", along, 0.0), ("across", across, np.pi / 2))
    }
    assert sd["along"][0] > 0.3 > 0.05 > sd["along"][1]
    assert sd["across"][1] > 0.3 > 0.05 > sd["across"][0]


# Kernels and their slow twins


def arrays(scan: Scan) -> tuple[Array, Array, Array, Array]:
    return Reference(scan).arrays


@pytest.mark.parametrize("mutual", [True, False])
@pytest.mark.parametrize("radius", [0.05, 0.5])
def test_twin_of_correspondences(room: Array, look: Look, mutual: bool, radius: float) -> None:
    reference, scan = pair(look, room)
    pose = MOVED + 0.05
    moved = se2.transform(pose, scan.points)
    apart = np.linalg.norm(moved[:, None] - reference.points[None], axis=-1)
    expected = np.where(apart.min(axis=1) < radius, apart.argmin(axis=1), -1)
    if mutual:
        back = apart.argmin(axis=0)
        expected[(expected >= 0) & (back[expected] != np.arange(len(scan)))] = -1
    assert np.any(expected < 0) == (mutual or radius < 0.1)
    assert np.sum(expected >= 0) > 20
    pairs = kernels.correspondences(
        reference.points, Reference(reference).index, scan.points, Reference(scan).index, pose, radius, mutual
    )
    np.testing.assert_array_equal(pairs, expected)
    np.testing.assert_array_equal(cKDTree(reference.points).query(moved)[1][pairs >= 0], pairs[pairs >= 0])


def plain_pair(
    method: str, reference: Scan, scan: Scan, j: int, i: int, pose: Array
) -> tuple[Array, Array, Array]:
    """Error e (2,), Jacobian H (2, 3) and weight W (2, 2) of one pair as the equations have them."""
    R = se2.rotation(pose[2])
    p = R @ scan.points[i]
    H = np.array([[1.0, 0.0, -p[1]], [0.0, 1.0, p[0]]])
    P = reference.covariance[j] + R @ scan.covariance[i] @ R.T
    n = reference.normals[j]
    if method == "icp":
        W = np.eye(2) / 0.02**2
    elif method == "wsm":
        W = np.linalg.inv(P)
    else:
        facing = n @ R @ scan.normals[i]
        W = np.outer(n, n) / (n @ P @ n) if facing > kernels.SIDE_COSINE else np.zeros((2, 2))
    return reference.points[j] - p - pose[:2], H, W


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("robust", [9.0, np.inf])
def test_twin_of_normal_equations(room: Array, look: Look, method: str, robust: float) -> None:
    reference, scan = pair(look, room)
    pose = MOVED + 0.02
    pairs = np.where(np.arange(len(scan)) % 4 == 0, -1, np.arange(len(scan)) % len(reference))
    information, gradient, used = np.zeros((3, 3)), np.zeros(3), 0
    costs, weights = [], []
    for i, j in enumerate(pairs):
        if j < 0:
            continue
        e, H, W = plain_pair(method, reference, scan, int(j), i, pose)
        if not np.any(W):
            continue
        chi2 = e @ W @ e
        W = W / (1.0 + chi2 / robust)
        information += H.T @ W @ H
        gradient += H.T @ W @ e
        costs.append(e @ W @ e)
        weights.append(np.trace(W))
        used += 1
    number = {"wsm": kernels.WSM, "icp": kernels.ICP, "plicp": kernels.PLICP}[method]
    result = kernels.normal_equations(number, arrays(reference), arrays(scan), pairs, pose, 0.02, robust)
    np.testing.assert_allclose(result[0], information, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(result[1], gradient, rtol=1e-9, atol=1e-6)
    assert result[2] == used > 50
    np.testing.assert_allclose(result[3:5], [np.sum(costs), np.sum(weights)], rtol=1e-9)


def test_twin_of_point_to_line_information(room: Array, look: Look) -> None:
    reference, scan = pair(look, room)
    pose, robust = MOVED + 0.01, 9.0
    pairs = np.where(np.arange(len(scan)) % 5 == 0, -1, np.arange(len(scan)) % len(reference))
    R, expected = se2.rotation(pose[2]), np.zeros((3, 3))
    for i, j in enumerate(pairs):
        n = reference.normals[j]
        if j < 0 or np.isnan(n[0]):
            continue
        p = R @ scan.points[i]
        H = np.array([[1.0, 0.0, -p[1]], [0.0, 1.0, p[0]]])
        P = reference.covariance[j] + R @ scan.covariance[i] @ R.T
        error, v = n @ (reference.points[j] - p - pose[:2]), n @ P @ n
        v = v * (1.0 + error**2 / v / robust)
        across, along = n @ H, np.array([-n[1], n[0]]) @ H
        expected += np.outer(across, across) / v
        expected -= reference.tangent_sigma[j] ** 2 * np.outer(along, along) / v
    result = kernels.point_to_line_information(arrays(reference), arrays(scan), pairs, pose, robust)
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-6)
