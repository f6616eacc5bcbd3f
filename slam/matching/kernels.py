"""The Gauss–Newton loop shared by the Weighted Scan Matcher and the ICP baselines.

Frames: reference points p1 and pose ``(t, φ)`` of the scan in the reference frame; e = p1 − (R p2 + t),
H = [I | J R p2], Λ = Σ Hᵀ W H, (δt, δφ) = Λ⁻¹ Σ Hᵀ W e. The methods differ in the pair weight W only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.neighbours import nearest

WSM, ICP, PLICP = 0, 1, 2
"""Pair weight: inverse of both points' covariances (Pfister 2002), constant, along the reference's normal."""

STILL, SETTLED = 1e-4, 5e-3
"""Largest step [m, rad] at which iterating stops, and at which a pose that still flickers between two sets of
pairs counts as converged."""

SIDE_COSINE = 0.7
"""Two surfaces whose oriented normals differ by more than 45° are not the same (both faces of a thin
wall)."""


@njit(cache=True)
def correspondences(reference, reference_index, scan, scan_index, pose, radius, mutual):
    """Row of the reference point paired with each scan point, -1 for none; mutual nearest neighbours if
    asked."""
    pairs = np.full(len(scan), -1, np.int64)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(scan)):
        x = c * scan[i, 0] - s * scan[i, 1] + pose[0]
        y = s * scan[i, 0] + c * scan[i, 1] + pose[1]
        j = nearest(reference, reference_index, x, y, radius)
        if j >= 0 and mutual:
            dx, dy = reference[j, 0] - pose[0], reference[j, 1] - pose[1]
            if nearest(scan, scan_index, c * dx + s * dy, -s * dx + c * dy, radius) != i:
                continue
        pairs[i] = j
    return pairs


@njit(cache=True)
def _pair_covariance(first, second, c, s):
    """P1 + R P2 Rᵀ as (xx, xy, yy)."""
    a, b, d = second[0, 0], second[0, 1], second[1, 1]
    xx = c * c * a - 2.0 * c * s * b + s * s * d
    xy = c * s * (a - d) + (c * c - s * s) * b
    yy = s * s * a + 2.0 * c * s * b + c * c * d
    return first[0, 0] + xx, first[0, 1] + xy, first[1, 1] + yy


@njit(cache=True)
def _pair_weight(method, normal, scan_normal, covariance, c, s, sigma):
    """Pair weight W as (xx, xy, yy); zero when the pair does not count."""
    if method == ICP:
        return 1.0 / sigma**2, 0.0, 1.0 / sigma**2
    xx, xy, yy = covariance
    if method == WSM:
        determinant = xx * yy - xy * xy
        return yy / determinant, -xy / determinant, xx / determinant
    nx, ny = normal
    facing = nx * (c * scan_normal[0] - s * scan_normal[1]) + ny * (s * scan_normal[0] + c * scan_normal[1])
    if not facing > SIDE_COSINE:
        return 0.0, 0.0, 0.0
    variance = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
    return nx * nx / variance, nx * ny / variance, ny * ny / variance


@njit(cache=True)
def normal_equations(method, reference, scan, pairs, pose, sigma, robust):
    """Information Λ (3, 3), gradient (3,), pairs used, Σ robust eᵀWe and Σ weights at one pose.

    ``reference`` and ``scan`` are tuples (points, normals, covariance, tangent_sigma). A pair's weight is
    scaled by 1 / (1 + χ²/robust) (Cauchy); ``robust`` = inf for none.
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
        pair = _pair_covariance(covariance[j], scan_covariance[i], c, s)
        xx, xy, yy = _pair_weight(method, normals[j], scan_normals[i], pair, c, s, sigma)
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
def point_to_line_information(reference, scan, pairs, pose, robust):
    """Information (3, 3) that wall normals alone carry, less what their own noise fabricates.

    Λ = Σ f_nᵀf_n / v − Σ σ_tan² f_tᵀf_t / v with v = nᵀ P n: closed-form covariances that ignore re-matching
    hold for point-to-line only (Bonnabel et al. 2016).
    """
    points, normals, covariance, tangent_sigma = reference
    scan_points, _, scan_covariance, _ = scan
    information = np.zeros((3, 3))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0 or not np.isfinite(normals[j, 0]):
            continue
        nx, ny = normals[j]
        rx = c * scan_points[i, 0] - s * scan_points[i, 1]
        ry = s * scan_points[i, 0] + c * scan_points[i, 1]
        xx, xy, yy = _pair_covariance(covariance[j], scan_covariance[i], c, s)
        v = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
        error = nx * (points[j, 0] - rx - pose[0]) + ny * (points[j, 1] - ry - pose[1])
        v *= 1.0 + error * error / v / robust
        across = np.array([nx, ny, -nx * ry + ny * rx])
        along = np.array([-ny, nx, ny * ry + nx * rx])
        noise = tangent_sigma[j] ** 2
        for a in range(3):
            for b in range(3):
                information[a, b] += (across[a] * across[b] - noise * along[a] * along[b]) / v
    return information


@njit(cache=True)
def fade_weak(information, gradient, total, length, threshold):
    """Information and gradient with directions of little mean information per weight smoothly taken out.

    Yaw is scaled by ``length`` m; each eigen-direction of Λ / Σw is multiplied by λ² / (λ² + threshold²).
    """
    scale = np.array([1.0, 1.0, 1.0 / length])
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale) / total)
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
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    step = np.zeros(3)
    for k in range(3):
        if values[k] > ratio * values[2] and values[k] > 0.0:
            step += vectors[:, k] * (np.dot(vectors[:, k], gradient * scale) / values[k])
    return step * scale


@njit(cache=True)
def iterate(method, reference, reference_index, scan, scan_index, guess, prior, settings, radii):
    """Pose (3,), Λ (3, 3) with weak directions faded, pairs, pairs used, cost, iterations, converged.

    ``prior (3, 3)`` is information about the guess (zeros for none). ``settings`` are (sigma, robust, mutual,
    length, fade threshold, freeze ratio, most iterations per radius).
    """
    sigma, robust, mutual, length, fade, ratio, most = settings
    pose = guess.copy()
    iterations, converged = 0, False
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    pairs = np.full(len(scan[0]), -1, np.int64)
    used, cost = 0, 0.0
    for radius in radii:
        converged = False
        for _ in range(int(most)):
            pairs = correspondences(
                reference[0], reference_index, scan[0], scan_index, pose, radius, mutual > 0.0
            )
            information, gradient, used, cost, total = normal_equations(
                method, reference, scan, pairs, pose, sigma, robust
            )
            if used == 0:
                break
            if fade > 0.0:
                information, gradient = fade_weak(information, gradient, total, length, fade)
            step = solve_good_directions(
                information + prior, gradient + prior @ (guess - pose), length, ratio
            )
            pose += step
            iterations += 1
            moved = max(np.hypot(step[0], step[1]), abs(step[2]))
            converged = moved < SETTLED
            if moved < STILL:
                break
    return pose, information, pairs, used, cost, iterations, converged


@njit(cache=True)
def linearise_pairs(cloud, offsets, lattice, first_offsets, pairs, guesses, radius, robust, fade, length):
    """One Gauss–Newton step, point to line, for each of many pairs of scans packed into one cloud.

    ``cloud`` is (points, normals, covariance, tangent_sigma) of all scans, scan k in rows
    ``offsets[k]:offsets[k+1]``; ``lattice`` is (low, cell, columns, rows, first, order) of their indices,
    ``first`` cut at ``first_offsets``. ``pairs (P, 2)`` reference and scan, ``guesses (P, 3)``. Returns
    the relative poses after the step ``(P, 3)``, the information in the reference's frame ``(P, 3, 3)``
    with weak directions faded, and the pairs of points ``(P,)``.
    """
    points, normals, covariance, tangent_sigma = cloud
    low, cell, columns, rows, first, order = lattice
    stepped, informations = guesses.copy(), np.zeros((len(pairs), 3, 3))
    counts = np.zeros(len(pairs), np.int64)
    for p in range(len(pairs)):
        i, j = pairs[p]
        a, b, c, d = offsets[i], offsets[i + 1], offsets[j], offsets[j + 1]
        if a == b or c == d:
            continue
        reference = (points[a:b], normals[a:b], covariance[a:b], tangent_sigma[a:b])
        scan = (points[c:d], normals[c:d], covariance[c:d], tangent_sigma[c:d])
        index = (
            low[i], cell[i], columns[i], rows[i], first[first_offsets[i] : first_offsets[i + 1]], order[a:b],
        )  # fmt: skip
        matched = correspondences(reference[0], index, scan[0], index, guesses[p], radius, False)
        information, gradient, used, _, total = normal_equations(
            PLICP, reference, scan, matched, guesses[p], 1.0, robust
        )
        counts[p] = used
        if used == 0:
            continue
        information, gradient = fade_weak(information, gradient, total, length, fade)
        stepped[p] += solve_good_directions(information, gradient, length, 1e-3)
        informations[p] = information
    return stepped, informations, counts
