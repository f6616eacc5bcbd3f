"""The Gauss–Newton loop shared by the Weighted Scan Matcher and the ICP baselines.

Frames: reference points p1 and pose ``(t, φ)`` of the scan in the reference frame; e = p1 − (R p2 + t),
H = [I | J R p2], Λ = Σ Hᵀ W H, (δt, δφ) = Λ⁻¹ Σ Hᵀ W e. The methods differ in the pair weight W only.

A *cloud* is a tuple (points (n, 2), normals (n, 2), covariance (n, 2, 2), tangent_sigma (n,)), an *indexed*
cloud is a tuple (cloud, lattice) with the lattice of `slam.matching.neighbours`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.neighbours import nearest
from slam.matching.symmetric import eigh3

WSM, ICP, PLICP = 0, 1, 2
"""Pair weight: inverse of both points' covariances (Pfister 2002), constant, along the reference's normal."""

STILL, SETTLED, ROUGH = 1e-4, 5e-3, 2e-2
"""Largest step [m, rad] at which iterating stops, at which a pose that still flickers between two sets of
pairs counts as converged, and at which a coarse level gives way to the next."""

SIDE_COSINE = 0.7
"""Two surfaces whose oriented normals differ by more than 45° are not the same (both faces of a thin
wall)."""


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
def pair_weight(method, normal, scan_normal, covariance, c, s, sigma, oriented):
    """Pair weight W as (xx, xy, yy); zero when the pair does not count."""
    if method == ICP:
        return 1.0 / sigma**2, 0.0, 1.0 / sigma**2
    xx, xy, yy = covariance
    if method == WSM:
        determinant = xx * yy - xy * xy
        return yy / determinant, -xy / determinant, xx / determinant
    nx, ny = normal
    facing = nx * (c * scan_normal[0] - s * scan_normal[1]) + ny * (s * scan_normal[0] + c * scan_normal[1])
    if not (facing if oriented else abs(facing)) > SIDE_COSINE:
        return 0.0, 0.0, 0.0
    variance = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
    return nx * nx / variance, nx * ny / variance, ny * ny / variance


@njit(cache=True)
def normal_equations(method, reference, scan, pairs, pose, sigma, robust, oriented):
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
        xx, xy, yy = pair_weight(method, normals[j], scan_normals[i], pair, c, s, sigma, oriented)
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
def descend(method, reference, scan, start, guess, prior, descent, levels, pairs):
    """Pose (3,), Λ (3, 3) with weak directions faded, pairs used, cost, iterations, converged.

    ``reference`` and ``scan`` are indexed clouds; ``prior (3, 3)`` is information about ``guess`` (zeros for
    none), which need not be where the descent starts; ``descent`` and ``levels (L, 2)`` are those of
    `slam.matching.config.MatchConfig`; ``pairs (n,)`` starts as hints and ends as the last pairs. The
    Weighted Scan Matcher weighs along the normal only until its last level: points that are far apart say
    little about the way along a wall.
    """
    sigma, robust, mutual, length, fade, ratio, most, oriented = descent
    pose = start.copy()
    iterations, converged = 0, False
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    used, cost = 0, 0.0
    for level in range(len(levels)):
        last = level == len(levels) - 1
        weighing = PLICP if method == WSM and not last else method
        for _ in range(most):
            correspondences(
                reference, scan, pose, levels[level, 0], mutual and last, int(levels[level, 1]), pairs
            )
            information, gradient, used, cost, total = normal_equations(
                weighing, reference[0], scan[0], pairs, pose, sigma, robust, oriented
            )
            if used == 0:
                converged = False
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
            if moved < (STILL if last else ROUGH):
                break
    return pose, information, used, cost, iterations, converged


@njit(cache=True)
def linearise_pairs(cloud, offsets, lattice, pairs, guesses, radius, robust, fade, length):
    """One Gauss–Newton step, point to line, for each of many pairs of scans packed into one cloud.

    ``cloud`` holds all scans, scan k in rows ``offsets[k]:offsets[k+1]``; ``lattice`` is (cell, heads (K,
    side, side), following) of their lattices. ``pairs (P, 2)`` reference and scan, ``guesses (P, 3)``.
    Returns the relative poses after the step ``(P, 3)``, the information in the reference's frame ``(P, 3,
    3)`` with weak directions faded, the pairs of points ``(P,)`` and their mean robust χ² ``(P,)``, NaN
    without any.
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
            PLICP, reference, scan, matched, guesses[p], 1.0, robust, True
        )
        counts[p] = used
        if used == 0:
            continue
        misfits[p] = cost / used
        information, gradient = fade_weak(information, gradient, total, length, fade)
        stepped[p] += solve_good_directions(information, gradient, length, 1e-3)
        informations[p] = information
    return stepped, informations, counts, misfits
