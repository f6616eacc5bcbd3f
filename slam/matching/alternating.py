"""Pfister's alternating solution of the weighted cost, as UsarCommander iterates it; for comparison."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.kernels import correspondences, normal_equations, pair_covariance, pair_weight

LAST, ALIKE, TIMES = 10, 0.01, 8
"""It stops once an error is within 1 % of one of the last ten, for the eighth time."""


@njit(cache=True)
def _displacement(method, reference, scan, pairs, pose, sigma, oriented):
    """Excess translation T (2,) and centre of rotation c (2,), both in the reference frame.

    T = (ΣW)⁻¹ ΣW(p2 − p1) and c = (2ΣJᵀWJ)⁻¹ ΣJᵀWJ(p1 + p2), where JᵀWJ is W's adjugate.
    """
    points, normals, covariance, _ = reference
    scan_points, scan_normals, scan_covariance, _ = scan
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    A, excess, middle = np.zeros((2, 2)), np.zeros(2), np.zeros(2)
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        pair = pair_covariance(covariance[j], scan_covariance[i], cos, sin)
        xx, xy, yy = pair_weight(method, normals[j], scan_normals[i], pair, cos, sin, sigma, oriented)
        x = cos * scan_points[i, 0] - sin * scan_points[i, 1] + pose[0]
        y = sin * scan_points[i, 0] + cos * scan_points[i, 1] + pose[1]
        ex, ey = x - points[j, 0], y - points[j, 1]
        mx, my = 0.5 * (x + points[j, 0]), 0.5 * (y + points[j, 1])
        A[0, 0] += xx
        A[0, 1] += xy
        A[1, 1] += yy
        excess[0] += xx * ex + xy * ey
        excess[1] += xy * ex + yy * ey
        middle[0] += yy * mx - xy * my
        middle[1] += xx * my - xy * mx
    A[1, 0] = A[0, 1]
    adjugate = np.array([[A[1, 1], -A[0, 1]], [-A[0, 1], A[0, 0]]])
    return np.linalg.solve(A, excess), np.linalg.solve(adjugate, middle)


@njit(cache=True)
def _turn(method, reference, scan, pairs, pose, sigma, oriented, excess, centre):
    """Rotation δφ of the scan about the centre that goes with the translation."""
    points, normals, covariance, _ = reference
    scan_points, scan_normals, scan_covariance, _ = scan
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    above, below = 0.0, 0.0
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        pair = pair_covariance(covariance[j], scan_covariance[i], cos, sin)
        xx, xy, yy = pair_weight(method, normals[j], scan_normals[i], pair, cos, sin, sigma, oriented)
        qx = cos * scan_points[i, 0] - sin * scan_points[i, 1] + pose[0] - excess[0] - centre[0]
        qy = sin * scan_points[i, 0] + cos * scan_points[i, 1] + pose[1] - excess[1] - centre[1]
        dx, dy = qx - (points[j, 0] - centre[0]), qy - (points[j, 1] - centre[1])
        above += dx * (-xx * qy + xy * qx) + dy * (-xy * qy + yy * qx)
        below += dx * (xx * qx + xy * qy) + dy * (xy * qx + yy * qy)
        below -= xx * qy * qy - 2.0 * xy * qx * qy + yy * qx * qx
    return above / below if below != 0.0 else 0.0


@njit(cache=True)
def alternate(method, reference, scan, guess, descent, radius, pairs):
    """Pose (3,), Λ (3, 3), pairs used, cost, iterations, converged: as `slam.matching.kernels.descend`.

    Translation about a centre, then rotation about it, from new mutual neighbours within ``radius`` m each
    time (Pfister et al. 2002).
    """
    sigma, robust, mutual, _, _, _, most, oriented = descent
    pose = guess.copy()
    errors = np.full(LAST, np.inf)
    alike, iterations = 0, 0
    while True:
        correspondences(reference, scan, pose, radius, mutual, 1, pairs)
        information, _, used, cost, _ = normal_equations(
            method, reference[0], scan[0], pairs, pose, sigma, robust, oriented
        )
        if used < 2:
            return pose, information, used, cost, iterations, False
        for error in errors:
            if abs(cost - error) <= ALIKE * cost:
                alike += 1
                break
        if alike >= TIMES or iterations >= most:
            return pose, information, used, cost, iterations, iterations < most
        errors[iterations % LAST] = cost
        excess, centre = _displacement(method, reference[0], scan[0], pairs, pose, sigma, oriented)
        turn = _turn(method, reference[0], scan[0], pairs, pose, sigma, oriented, excess, centre)
        c, s = np.cos(turn), np.sin(turn)
        x, y = pose[0] - excess[0] - centre[0], pose[1] - excess[1] - centre[1]
        pose = np.array([c * x - s * y + centre[0], s * x + c * y + centre[1], pose[2] + turn])
        iterations += 1
