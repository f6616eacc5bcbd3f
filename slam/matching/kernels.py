"""Numba kernels of the matchers wsm, icp and plicp: pairs, their weights, and the two ways to descend.

Frames: reference points p1 and pose ``(t, φ)`` of the scan in the reference frame; e = p1 − (R p2 + t),
H = [I | J R p2], Λ = Σ Hᵀ W H, (δt, δφ) = Λ⁻¹ Σ Hᵀ W e. The matchers differ in the pair weight W only.

A *cloud* is a tuple (points (n, 2), normals (n, 2), covariance (n, 2, 2), tangent_sigma (n,)), an *indexed*
cloud is a tuple (cloud, lattice) with the lattice of `slam.matching.neighbours`. ``settings`` are the
`slam.matching.config.KernelSettings`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.config import DEFAULT, ICP, PLICP, WSM
from slam.matching.neighbours import nearest

SWEEPS = 12
"""More than enough: Jacobi rotations converge quadratically, and five do for three rows."""

LAST_ERRORS, SAME_ERROR, REPEATS = 10, 0.01, 8
"""When UsarCommander's alternation ends: an error is within 1 % of one of the last ten, for the eighth
time."""


@njit(cache=True)
def eigh3(matrix):
    """Eigenvalues ``(3,)`` ascending and eigenvectors in the columns of ``(3, 3)`` (cyclic Jacobi)."""
    a, v = 0.5 * (matrix + matrix.T), np.eye(3)
    for _ in range(SWEEPS):
        off = a[0, 1] ** 2 + a[0, 2] ** 2 + a[1, 2] ** 2
        if off <= 1e-30 * (a[0, 0] ** 2 + a[1, 1] ** 2 + a[2, 2] ** 2):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                tau = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = (1.0 if tau >= 0.0 else -1.0) / (abs(tau) + np.sqrt(1.0 + tau * tau))
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = t * c
                for k in range(3):
                    a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
                for k in range(3):
                    a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
                for k in range(3):
                    v[k, p], v[k, q] = c * v[k, p] - s * v[k, q], s * v[k, p] + c * v[k, q]
    order = np.argsort(np.diag(a))
    return np.diag(a)[order], v[:, order]


@njit(cache=True)
def correspondences(reference, scan, pose, radius, mutual, stride, pairs):
    """Write the row of the reference's point paired with every ``stride``-th scan point into ``pairs``, -1
    for none; mutual nearest neighbours if asked.

    What ``pairs (n,)`` held before is where the search starts. ``reference`` and ``scan`` are indexed clouds.
    """
    (points, _, _, _), lattice = reference
    (scan_points, _, _, _), scan_lattice = scan
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(scan_points)):
        if i % stride != stride // 2:
            pairs[i] = -1
            continue
        x = c * scan_points[i, 0] - s * scan_points[i, 1] + pose[0]
        y = s * scan_points[i, 0] + c * scan_points[i, 1] + pose[1]
        j = nearest(points, lattice, x, y, radius, pairs[i])
        if j >= 0 and mutual:
            dx, dy = points[j, 0] - pose[0], points[j, 1] - pose[1]
            if nearest(scan_points, scan_lattice, c * dx + s * dy, -s * dx + c * dy, radius, i) != i:
                j = -1
        pairs[i] = j


@njit(cache=True)
def pair_covariance(first, second, c, s):
    """P1 + R P2 Rᵀ as (xx, xy, yy)."""
    a, b, d = second[0, 0], second[0, 1], second[1, 1]
    xx = c * c * a - 2.0 * c * s * b + s * s * d
    xy = c * s * (a - d) + (c * c - s * s) * b
    yy = s * s * a + 2.0 * c * s * b + c * c * d
    return first[0, 0] + xx, first[0, 1] + xy, first[1, 1] + yy


@njit(cache=True)
def pair_weight(method, normal, scan_normal, covariance, c, s, sigma, oriented, same_side):
    """Pair weight W as (xx, xy, yy); zero when the pair does not count."""
    if method == ICP:
        return 1.0 / sigma**2, 0.0, 1.0 / sigma**2
    xx, xy, yy = covariance
    if method == WSM:
        determinant = xx * yy - xy * xy
        return yy / determinant, -xy / determinant, xx / determinant
    nx, ny = normal
    facing = nx * (c * scan_normal[0] - s * scan_normal[1]) + ny * (s * scan_normal[0] + c * scan_normal[1])
    if not (facing if oriented else abs(facing)) > same_side:
        return 0.0, 0.0, 0.0
    variance = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
    return nx * nx / variance, nx * ny / variance, ny * ny / variance


@njit(cache=True)
def normal_equations(method, reference, scan, pairs, pose, sigma, robust, oriented, same_side):
    """Information Λ (3, 3), gradient (3,), pairs used, Σ robust eᵀWe and Σ weights at one pose.

    ``reference`` and ``scan`` are clouds. A pair's weight is scaled by 1 / (1 + χ²/robust) (Cauchy);
    ``robust`` = inf for none.
    """
    points, normals, covariance, _ = reference
    scan_points, scan_normals, scan_covariance, _ = scan
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    used, cost, total = 0, 0.0, 0.0
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        rx = c * scan_points[i, 0] - s * scan_points[i, 1]
        ry = s * scan_points[i, 0] + c * scan_points[i, 1]
        pair = pair_covariance(covariance[j], scan_covariance[i], c, s)
        xx, xy, yy = pair_weight(method, normals[j], scan_normals[i], pair, c, s, sigma, oriented, same_side)
        if xx + yy <= 0.0:
            continue
        ex, ey = points[j, 0] - rx - pose[0], points[j, 1] - ry - pose[1]
        chi2 = ex * ex * xx + 2.0 * ex * ey * xy + ey * ey * yy
        w = 1.0 / (1.0 + chi2 / robust)
        xx, xy, yy = w * xx, w * xy, w * yy
        hx, hy = -ry, rx  # J R p2
        wx, wy = xx * hx + xy * hy, xy * hx + yy * hy
        information[0, 0] += xx
        information[0, 1] += xy
        information[1, 1] += yy
        information[0, 2] += wx
        information[1, 2] += wy
        information[2, 2] += hx * wx + hy * wy
        gx, gy = xx * ex + xy * ey, xy * ex + yy * ey
        gradient[0] += gx
        gradient[1] += gy
        gradient[2] += hx * gx + hy * gy
        used += 1
        cost += w * chi2
        total += xx + yy
    information[1, 0], information[2, 0] = information[0, 1], information[0, 2]
    information[2, 1] = information[1, 2]
    return information, gradient, used, cost, total


@njit(cache=True)
def fade_weak(information, gradient, total, length, threshold):
    """Information and gradient with directions of little mean information per weight smoothly taken out.

    Yaw is scaled by ``length`` m; each eigen-direction of Λ / Σw is multiplied by λ² / (λ² + threshold²).
    """
    scale = np.array([1.0, 1.0, 1.0 / length])
    values, vectors = eigh3(information * np.outer(scale, scale) / total)
    gains = np.empty(3)
    for k in range(3):
        value = max(values[k], 0.0)
        gains[k] = value * value / (value * value + threshold * threshold) if threshold > 0.0 else 1.0
    unscale = 1.0 / scale
    faded = (vectors * (np.maximum(values, 0.0) * gains)) @ vectors.T * total
    pulled = (vectors * gains) @ vectors.T @ (gradient * scale)
    return faded * np.outer(unscale, unscale), pulled * unscale


@njit(cache=True)
def solve_good_directions(information, gradient, length, ratio):
    """Λ⁻¹ g along well-determined eigenvectors only; directions below ``ratio`` of the strongest are
    frozen."""
    scale = np.array([1.0, 1.0, 1.0 / length])
    values, vectors = eigh3(information * np.outer(scale, scale))
    step = np.zeros(3)
    for k in range(3):
        if values[k] > ratio * values[2] and values[k] > 0.0:
            step += vectors[:, k] * (np.sum(vectors[:, k] * gradient * scale) / values[k])
    return step * scale


@njit(cache=True)
def descend(method, reference, scan, start, guess, prior, settings, levels, pairs):
    """Pose (3,), Λ (3, 3) with weak directions faded, pairs used, cost, iterations, converged.

    ``reference`` and ``scan`` are indexed clouds; ``prior (3, 3)`` is information about ``guess`` (zeros for
    none), which need not be where the descent starts; ``levels (L, 2)`` as in
    `slam.matching.config.MatchConfig`; ``pairs (n,)`` starts as hints and ends as the last pairs. The
    Weighted Scan Matcher weighs along the normal only until its last level: points that are far apart say
    little about the way along a wall.
    """
    pose = start.copy()
    iterations, converged = 0, False
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    used, cost = 0, 0.0
    for level in range(len(levels)):
        last = level == len(levels) - 1
        weighing = PLICP if method == WSM and not last else method
        mutual, stride = settings.mutual and last, int(levels[level, 1])
        for _ in range(settings.most_iterations):
            correspondences(reference, scan, pose, levels[level, 0], mutual, stride, pairs)
            information, gradient, used, cost, total = normal_equations(
                weighing, reference[0], scan[0], pairs, pose,
                settings.sigma, settings.robust, settings.oriented, settings.same_side,
            )  # fmt: skip
            if used == 0:
                converged = False
                break
            if settings.fade > 0.0:
                information, gradient = fade_weak(
                    information, gradient, total, settings.length, settings.fade
                )
            step = solve_good_directions(
                information + prior, gradient + prior @ (guess - pose), settings.length, settings.freeze_ratio
            )
            pose += step
            iterations += 1
            moved = max(np.hypot(step[0], step[1]), abs(step[2]))
            converged = moved < settings.converged_step
            if moved < (settings.last_step if last else settings.coarse_step):
                break
    return pose, information, used, cost, iterations, converged


@njit(cache=True)
def displacement(method, reference, scan, pairs, pose, settings):
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
        xx, xy, yy = pair_weight(
            method, normals[j], scan_normals[i], pair, cos, sin,
            settings.sigma, settings.oriented, settings.same_side,
        )  # fmt: skip
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
def rotation_about(method, reference, scan, pairs, pose, settings, excess, centre):
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
        xx, xy, yy = pair_weight(
            method, normals[j], scan_normals[i], pair, cos, sin,
            settings.sigma, settings.oriented, settings.same_side,
        )  # fmt: skip
        qx = cos * scan_points[i, 0] - sin * scan_points[i, 1] + pose[0] - excess[0] - centre[0]
        qy = sin * scan_points[i, 0] + cos * scan_points[i, 1] + pose[1] - excess[1] - centre[1]
        dx, dy = qx - (points[j, 0] - centre[0]), qy - (points[j, 1] - centre[1])
        above += dx * (-xx * qy + xy * qx) + dy * (-xy * qy + yy * qx)
        below += dx * (xx * qx + xy * qy) + dy * (xy * qx + yy * qy)
        below -= xx * qy * qy - 2.0 * xy * qx * qy + yy * qx * qx
    return above / below if below != 0.0 else 0.0


@njit(cache=True)
def alternate(method, reference, scan, guess, settings, radius, pairs):
    """Pose (3,), Λ (3, 3), pairs used, cost, iterations, converged, as `descend` does.

    Pfister's alternating solution of the weighted cost (2002) as UsarCommander iterates it: translation about
    a centre, then rotation about it, from new neighbours within ``radius`` m each time.
    """
    pose = guess.copy()
    errors = np.full(LAST_ERRORS, np.inf)
    alike, iterations = 0, 0
    while True:
        correspondences(reference, scan, pose, radius, settings.mutual, 1, pairs)
        information, _, used, cost, _ = normal_equations(
            method, reference[0], scan[0], pairs, pose,
            settings.sigma, settings.robust, settings.oriented, settings.same_side,
        )  # fmt: skip
        if used < 2:
            return pose, information, used, cost, iterations, False
        for error in errors:
            if abs(cost - error) <= SAME_ERROR * cost:
                alike += 1
                break
        if alike >= REPEATS or iterations >= settings.most_iterations:
            return pose, information, used, cost, iterations, iterations < settings.most_iterations
        errors[iterations % LAST_ERRORS] = cost
        excess, centre = displacement(method, reference[0], scan[0], pairs, pose, settings)
        turn = rotation_about(method, reference[0], scan[0], pairs, pose, settings, excess, centre)
        c, s = np.cos(turn), np.sin(turn)
        x, y = pose[0] - excess[0] - centre[0], pose[1] - excess[1] - centre[1]
        pose = np.array([c * x - s * y + centre[0], s * x + c * y + centre[1], pose[2] + turn])
        iterations += 1


@njit(cache=True)
def linearise_pairs(
    cloud, offsets, lattice, pairs, guesses, radius, robust, fade, length,
    same_side=DEFAULT.same_side, freeze_ratio=DEFAULT.freeze_ratio,
):  # fmt: skip
    """One Gauss–Newton step, point to line, for each of many pairs of scans packed into one cloud.

    ``cloud`` holds all scans, scan k in rows ``offsets[k]:offsets[k+1]``; ``lattice`` is (cell, heads (K,
    side, side), following) of their lattices. ``pairs (P, 2)`` reference and scan, ``guesses (P, 3)``.
    Returns the relative poses after the step ``(P, 3)``, the information in the reference's frame ``(P, 3,
    3)`` with weak directions faded, the numbers of paired points ``(P,)`` and their mean robust χ² ``(P,)``,
    NaN without any.
    """
    points, normals, covariance, tangent_sigma = cloud
    cell, heads, following = lattice
    stepped, informations = guesses.copy(), np.zeros((len(pairs), 3, 3))
    counts, misfits = np.zeros(len(pairs), np.int64), np.full(len(pairs), np.nan)
    for p in range(len(pairs)):
        i, j = pairs[p]
        a, b, c, d = offsets[i], offsets[i + 1], offsets[j], offsets[j + 1]
        if a == b or c == d:
            continue
        reference = (points[a:b], normals[a:b], covariance[a:b], tangent_sigma[a:b])
        scan = (points[c:d], normals[c:d], covariance[c:d], tangent_sigma[c:d])
        indexed = (reference, (cell, heads[i], following[a:b]))
        indexed_scan = (scan, (cell, heads[j], following[c:d]))
        matched = np.full(d - c, -1, np.int64)
        correspondences(indexed, indexed_scan, guesses[p], radius, False, 1, matched)
        information, gradient, used, cost, total = normal_equations(
            PLICP, reference, scan, matched, guesses[p], 1.0, robust, True, same_side
        )
        counts[p] = used
        if used == 0:
            continue
        misfits[p] = cost / used
        information, gradient = fade_weak(information, gradient, total, length, fade)
        stepped[p] += solve_good_directions(information, gradient, length, freeze_ratio)
        informations[p] = information
    return stepped, informations, counts, misfits


@njit(cache=True)
def place(cloud, T_map_cloud, target, first):
    """Write a cloud, moved by ``T_map_cloud (3,)``, into the cloud ``target`` from row ``first`` on."""
    points, normals, covariance, tangent_sigma = cloud
    target_points, target_normals, target_covariance, target_sigma = target
    c, s = np.cos(T_map_cloud[2]), np.sin(T_map_cloud[2])
    zero = np.zeros((2, 2))
    for i in range(len(points)):
        k = first + i
        target_points[k, 0] = c * points[i, 0] - s * points[i, 1] + T_map_cloud[0]
        target_points[k, 1] = s * points[i, 0] + c * points[i, 1] + T_map_cloud[1]
        target_normals[k, 0] = c * normals[i, 0] - s * normals[i, 1]
        target_normals[k, 1] = s * normals[i, 0] + c * normals[i, 1]
        xx, xy, yy = pair_covariance(zero, covariance[i], c, s)
        target_covariance[k, 0, 0], target_covariance[k, 1, 1] = xx, yy
        target_covariance[k, 0, 1] = target_covariance[k, 1, 0] = xy
        target_sigma[k] = tangent_sigma[i]


@njit(cache=True)
def look(bearings, ranges, points, gap, margin, looked, free):
    """Count in ``looked`` and ``free (n,)`` the points, in the laser's frame, that one sight sees so."""
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        bearing, distance = np.arctan2(y, x), np.sqrt(x * x + y * y)
        after = min(max(np.searchsorted(bearings, bearing), 1), len(bearings) - 1)
        before = after - 1
        if min(abs(bearing - bearings[before]), abs(bearings[after] - bearing)) > gap:
            continue
        near, far = min(ranges[before], ranges[after]), max(ranges[before], ranges[after])
        if distance < far + margin:
            looked[i] += 1
            if distance < near - margin:
                free[i] += 1
