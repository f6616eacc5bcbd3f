"""The matcher's kernels against slow twins that follow the equations word by word."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slam import se2
from slam.matching import MatchConfig, Reference, kernels
from slam.matching.covariance import (
    body_covariance,
    floored_inverse,
    pfister_block,
    point_to_line_information,
)
from slam.scan import Scan
from slam.se2 import Array

METHODS = {"wsm": kernels.WSM, "icp": kernels.ICP, "plicp": kernels.PLICP}
FROM = np.array([2.0, 2.5, 0.3])
MOVED = np.array([0.15, -0.08, 0.06])
J = np.array([[0.0, -1.0], [1.0, 0.0]])
SETTINGS = MatchConfig().kernel_settings

Look = Callable[..., Scan]


@pytest.fixture(scope="module")
def looks(room: Array, look: Look) -> tuple[Scan, Scan]:
    """Noisy scans from `FROM` and from `MOVED` seen from there."""
    rng = np.random.default_rng(0)
    return look(room, FROM, rng), look(room, se2.compose(FROM, MOVED), rng)


def every(step: int, reference: Scan, scan: Scan) -> np.ndarray:
    """Arbitrary pairs, every ``step``-th point left out."""
    rows = np.arange(len(scan))
    return np.where(rows % step == 0, -1, rows % len(reference))


def plain_pair(
    method: str, reference: Scan, scan: Scan, j: int, i: int, pose: Array, oriented: bool = True
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
        facing = facing if oriented else abs(facing)
        W = np.outer(n, n) / (n @ P @ n) if facing > SETTINGS.same_side else np.zeros((2, 2))
    return reference.points[j] - p - pose[:2], H, W


@pytest.mark.parametrize("mutual", [True, False])
@pytest.mark.parametrize("radius", [0.05, 0.5])
@pytest.mark.parametrize("stride", [1, 3])
def test_twin_of_correspondences(looks: tuple[Scan, Scan], mutual: bool, radius: float, stride: int) -> None:
    reference, scan = looks
    pose = MOVED + 0.05
    moved = se2.transform(pose, scan.points)
    apart = np.linalg.norm(moved[:, None] - reference.points[None], axis=-1)
    expected = np.where(apart.min(axis=1) < radius, apart.argmin(axis=1), -1)
    if mutual:
        back = apart.argmin(axis=0)
        expected[(expected >= 0) & (back[expected] != np.arange(len(scan)))] = -1
    expected[np.arange(len(scan)) % stride != stride // 2] = -1
    assert np.sum(expected >= 0) > 20 / stride
    for hints in (np.full(len(scan), -1), np.arange(len(scan)) % len(reference)):
        pairs = hints.astype(np.int64)
        kernels.correspondences(
            Reference(reference).indexed, Reference(scan).indexed, pose, radius, mutual, stride, pairs
        )
        np.testing.assert_array_equal(pairs, expected)
    np.testing.assert_array_equal(cKDTree(reference.points).query(moved)[1][pairs >= 0], pairs[pairs >= 0])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("robust", [9.0, np.inf])
@pytest.mark.parametrize("oriented", [True, False])
def test_twin_of_normal_equations(
    looks: tuple[Scan, Scan], method: str, robust: float, oriented: bool
) -> None:
    reference, scan = looks
    pose = MOVED + 0.02
    pairs = every(4, reference, scan)
    information, gradient, used = np.zeros((3, 3)), np.zeros(3), 0
    costs, weights = [], []
    for i, j in enumerate(pairs):
        if j < 0:
            continue
        e, H, W = plain_pair(method, reference, scan, int(j), i, pose, oriented)
        if not np.any(W):
            continue
        chi2 = e @ W @ e
        W = W / (1.0 + chi2 / robust)
        information += H.T @ W @ H
        gradient += H.T @ W @ e
        costs.append(e @ W @ e)
        weights.append(np.trace(W))
        used += 1
    result = kernels.normal_equations(
        METHODS[method],
        Reference(reference).cloud,
        Reference(scan).cloud,
        pairs,
        pose,
        0.02,
        robust,
        oriented,
        SETTINGS.same_side,
    )
    np.testing.assert_allclose(result[0], information, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(result[1], gradient, rtol=1e-9, atol=1e-6)
    assert result[2] == used > 50
    np.testing.assert_allclose(result[3:5], [np.sum(costs), np.sum(weights)], rtol=1e-9)


def test_twin_of_point_to_line_information(looks: tuple[Scan, Scan]) -> None:
    reference, scan = looks
    pose, robust = MOVED + 0.01, 9.0
    pairs = every(5, reference, scan)
    R, expected = se2.rotation(pose[2]), np.zeros((3, 3))
    for i, j in enumerate(pairs):
        n = reference.normals[j]
        if j < 0 or not n @ R @ scan.normals[i] > SETTINGS.same_side:
            continue
        p = R @ scan.points[i]
        H = np.array([[1.0, 0.0, -p[1]], [0.0, 1.0, p[0]]])
        P = reference.covariance[j] + R @ scan.covariance[i] @ R.T
        error, v = n @ (reference.points[j] - p - pose[:2]), n @ P @ n
        v = v * (1.0 + error**2 / v / robust)
        across, along = n @ H, np.array([-n[1], n[0]]) @ H
        expected += np.outer(across, across) / v
        expected -= reference.tangent_sigma[j] ** 2 * np.outer(along, along) / v
    clouds = Reference(reference).cloud, Reference(scan).cloud
    result = point_to_line_information(*clouds, pairs, pose, robust, SETTINGS.same_side)
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-6)


def plain_block(reference: Scan, scan: Scan, pairs: np.ndarray, pose: Array, first: bool) -> Array:
    """Pfister's block form, with every pair's W or with the first one's in the place of all (P_tt apart)."""
    R = se2.rotation(pose[2])
    pq = [(R @ scan.points[i], plain_pair("wsm", reference, scan, int(j), i, pose)[2])
          for i, j in enumerate(pairs) if j >= 0]  # fmt: skip
    A = np.sum([W for _, W in pq], axis=0)
    c = np.linalg.solve(
        np.sum([J.T @ W @ J for _, W in pq], axis=0), np.sum([J.T @ W @ J @ p for p, W in pq], axis=0)
    )
    if first:
        pq = [(p, pq[0][1]) for p, _ in pq]
    kappa = np.sum([(J @ (p - c)) @ W @ (J @ (p - c)) for p, W in pq])
    b = np.sum([W @ J @ (p - c) for p, W in pq], axis=0)
    block = np.zeros((3, 3))
    block[:2, :2] = np.linalg.inv(A)
    block[:2, 2] = block[2, :2] = -np.linalg.solve(np.sum([W for _, W in pq], axis=0), b) / kappa
    block[2, 2] = 1.0 / kappa
    S = np.array([[1.0, 0.0, c[1]], [0.0, 1.0, -c[0]], [0.0, 0.0, 1.0]])
    return S @ block @ S.T


def test_twin_of_the_block_form(looks: tuple[Scan, Scan]) -> None:
    reference, scan = looks
    clouds = Reference(reference).cloud, Reference(scan).cloud
    pairs = every(4, reference, scan)
    expected = plain_block(reference, scan, pairs, MOVED, first=True)
    np.testing.assert_allclose(pfister_block(*clouds, pairs, MOVED), expected, rtol=1e-9, atol=1e-14)


def test_with_every_pairs_own_weight_the_block_form_is_the_joint_one(looks: tuple[Scan, Scan]) -> None:
    reference, scan = looks
    pairs = every(4, reference, scan)
    information = kernels.normal_equations(
        kernels.WSM, Reference(reference).cloud, Reference(scan).cloud, pairs, MOVED, 0.02, np.inf, True, 0.7
    )[0]
    own = plain_block(reference, scan, pairs, MOVED, first=False)
    np.testing.assert_allclose(own, np.linalg.inv(information), rtol=1e-6, atol=1e-14)


def test_the_block_form_may_be_indefinite_as_the_published_ones_are(room: Array, look: Look) -> None:
    rng = np.random.default_rng(1)
    smallest = []
    for _ in range(60):
        pose = FROM + rng.uniform(-1.0, 1.0, 3) * [1.0, 1.0, np.pi]
        reference, scan = look(room, pose, rng), look(room, se2.compose(pose, MOVED), rng)
        indexed = Reference(reference).indexed, Reference(scan).indexed
        pairs = np.full(len(scan), -1, dtype=np.int64)
        kernels.correspondences(*indexed, MOVED, 0.5, True, 1, pairs)
        smallest.append(np.linalg.eigvalsh(pfister_block(indexed[0][0], indexed[1][0], pairs, MOVED))[0])
    assert 0 < np.sum(np.array(smallest) < 0.0) < 60


def test_twin_of_the_alternating_step(looks: tuple[Scan, Scan]) -> None:
    reference, scan = looks
    pose = MOVED + 0.01
    pairs = every(4, reference, scan)
    R = se2.rotation(pose[2])
    p1 = [reference.points[j] for j in pairs if j >= 0]
    p2 = [R @ scan.points[i] + pose[:2] for i, j in enumerate(pairs) if j >= 0]
    W = [plain_pair("wsm", reference, scan, int(j), i, pose)[2] for i, j in enumerate(pairs) if j >= 0]
    T = np.linalg.solve(
        np.sum(W, axis=0), np.sum([w @ (b - a) for a, b, w in zip(p1, p2, W, strict=True)], axis=0)
    )
    turned = [J.T @ w @ J for w in W]
    c = np.linalg.solve(
        2.0 * np.sum(turned, axis=0),
        np.sum([w @ (a + b) for a, b, w in zip(p1, p2, turned, strict=True)], axis=0),
    )
    above = below = 0.0
    for a, b, w in zip(p1, p2, W, strict=True):
        q = b - T - c
        dp = q - (a - c)
        above += dp @ w @ J @ q
        below += dp @ w @ q - (J @ q) @ w @ (J @ q)
    clouds = Reference(reference).cloud, Reference(scan).cloud
    excess, centre = kernels.displacement(kernels.WSM, *clouds, pairs, pose, SETTINGS)
    np.testing.assert_allclose(excess, T, rtol=1e-9)
    np.testing.assert_allclose(centre, c, rtol=1e-9)
    turn = kernels.rotation_about(kernels.WSM, *clouds, pairs, pose, SETTINGS, excess, centre)
    assert turn == pytest.approx(above / below, rel=1e-9)


def test_the_inverse_is_floored() -> None:
    R = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    covariance = floored_inverse((R * [1e4, 1e-3, -50.0]) @ R.T, 1.0)
    np.testing.assert_allclose(covariance, (R * [1e-4, 1.0, 1.0]) @ R.T, atol=1e-12)


def test_the_spread_of_other_answers_is_added_in_the_body(looks: tuple[Scan, Scan]) -> None:
    reference, scan = looks
    clouds = Reference(reference).cloud, Reference(scan).cloud
    pairs = every(4, reference, scan)
    pose = np.array([0.0, 0.0, 0.5 * np.pi])
    spread = np.diag([0.04, 0.0, 0.0])
    none = np.zeros((3, 3))
    information = np.diag([1e4, 1e4, 1e6])
    alone, _ = body_covariance(1, *clouds, pairs, pose, information, none, none, SETTINGS)
    both, values = body_covariance(1, *clouds, pairs, pose, information, none, spread, SETTINGS)
    np.testing.assert_allclose(both - alone, np.diag([0.0, 0.04, 0.0]), atol=1e-12)
    np.testing.assert_allclose(values, [1e4, 1e4, 2.5e5])


def assert_decomposed(matrix: Array) -> None:
    values, vectors = kernels.eigh3(matrix)
    scale = max(np.abs(matrix).max(), 1e-300)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-13 * scale)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-13)
    np.testing.assert_allclose((vectors * values) @ vectors.T, matrix, atol=1e-13 * scale)


def test_twin_of_the_eigenvectors() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 3, 3)
        assert_decomposed(0.5 * (root + root.T))
        assert_decomposed(root @ root.T)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.eye(3), np.diag([3.0, 1.0, 2.0]), np.ones((3, 3)), -np.diag([1.0, 1.0, 5.0])],
)
def test_repeated_and_ordered_eigenvalues(matrix: Array) -> None:
    assert_decomposed(matrix)
