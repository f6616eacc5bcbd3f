"""Kernels that ask whether two scans at known poses can both be right: what each sees where the other saw a
wall, and the shift that would lay one's walls onto the other's. A scan is its beams in its laser's frame, so
that a point of one is looked up in the other by its bearing."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, inline="always")
def _beam_at(bearing, angles):
    """Index of the beam nearest to a bearing [rad] among ``angles (B,)``, evenly spread; -1 out of view."""
    step = (angles[-1] - angles[0]) / (len(angles) - 1)
    k = int(np.round(((bearing - angles[0] + 0.5 * step) % (2.0 * np.pi) - 0.5 * step) / step))
    return k if k < len(angles) else -1


@njit(cache=True)
def meetings(ranges, angles, points, T_ab, tolerance):
    """What scan a, ``ranges (B,)`` m at ``angles (B,)`` rad with NaN for none, sees where scan b has
    ``points (n, 2)`` m, NaN rows for none; ``T_ab (3,)`` maps b into a.

    Returns ``(n,)`` int8: 1 where a sees a wall there too, -1 where it looks through, 0 where it does not
    tell: out of view, no return, hidden. ``tolerance`` is m, m per m of range, and half a width m: looked
    through is only what is nearer than all beams within that of it, so that edges and walls seen at grazing
    incidence contradict nothing.
    """
    met = np.zeros(len(points), dtype=np.int8)
    c, s = np.cos(T_ab[2]), np.sin(T_ab[2])
    step = (angles[-1] - angles[0]) / (len(angles) - 1)
    for j in range(len(points)):
        x = T_ab[0] + c * points[j, 0] - s * points[j, 1]
        y = T_ab[1] + s * points[j, 0] + c * points[j, 1]
        distance = np.hypot(x, y)
        if not distance > 0.0:  # also NaN
            continue
        k = _beam_at(np.arctan2(y, x), angles)
        if k < 0 or np.isnan(ranges[k]):
            continue
        allowed = tolerance[0] + tolerance[1] * distance
        reach = int(np.ceil(tolerance[2] / distance / step))
        least, sees_wall = np.inf, False
        for other in range(max(k - reach, 0), min(k + reach + 1, len(ranges))):
            if not np.isnan(ranges[other]):
                least = min(least, ranges[other])
                sees_wall |= abs(distance - ranges[other]) <= allowed
        if distance < least - allowed:
            met[j] = -1
        elif sees_wall:
            met[j] = 1
    return met


@njit(cache=True)
def misfit(a, b, angles, T_ab, gate, prior):
    """How far [m] scan b's walls lie off scan a's, by the rigid shift that fits them best; how far [m] such a
    shift is expected to be off by the scatter of the points; and the number of points that met.

    ``a`` and ``b (B, 4)`` are points [m] and normals of the beams at ``angles (B,)`` rad in the frame of
    their laser, NaN for none. A point of b meets the beam of a at its bearing if their normals are less than
    45° apart and it is within ``gate`` m of that wall. Three steps of Gauss-Newton on the distances from a's
    walls, weighed by Geman-McClure, with a ``prior (3,)`` of standard deviations: of a single distance m, and
    of the shift m and rad, which holds directions in which nothing is seen. The shift is the rms of what it
    moves the points by along a's normals, and no more than it makes them fit better by: noise and what moved
    are not in it.
    """
    T = T_ab.copy()
    inverse_variance = np.array([prior[1], prior[1], prior[2]]) ** -2.0
    met, moved, scatter, before = 0, 0.0, 0.0, 0.0
    for turn in range(4):
        c, s = np.cos(T[2]), np.sin(T[2])
        H = np.diag(inverse_variance)
        g = inverse_variance * (T - T_ab)
        met, moved, scatter = 0, 0.0, 0.0
        for j in range(len(b)):
            if np.isnan(b[j, 2]):
                continue
            rx, ry = c * b[j, 0] - s * b[j, 1], s * b[j, 0] + c * b[j, 1]
            k = _beam_at(np.arctan2(T[1] + ry, T[0] + rx), angles)
            if k < 0 or np.isnan(a[k, 2]):
                continue
            nx, ny = a[k, 2], a[k, 3]
            facing = nx * (c * b[j, 2] - s * b[j, 3]) + ny * (s * b[j, 2] + c * b[j, 3])
            off = nx * (T[0] + rx - a[k, 0]) + ny * (T[1] + ry - a[k, 1])
            if facing < np.sqrt(0.5) or abs(off) > gate:
                continue
            J = np.array([nx, ny, ny * rx - nx * ry])
            weight = (1.0 + (2.0 * off / gate) ** 2) ** -2.0
            met += 1
            moved += np.sum(J * (T - T_ab)) ** 2
            scatter += off * off
            for p in range(3):
                g[p] += weight * J[p] * off / prior[0] ** 2
                for q in range(3):
                    H[p, q] += weight * J[p] * J[q] / prior[0] ** 2
        if met < 3 or turn == 3:
            break
        if turn == 0:
            before = scatter / met
        T = T - np.linalg.solve(H, g)
    if met < 3:
        return 0.0, 0.0, met
    explained = max(before - scatter / met, 0.0)
    return np.sqrt(min(moved / met, explained)), np.sqrt(3.0 * scatter) / met, met


@njit(cache=True)
def choose_partners(poses, path, most, radius, detour, apart):
    """Pairs ``(P, 2)``, later before earlier, of the scans at ``poses (K, 3)`` that saw one place in
    different passes: within ``radius`` m of each other though ``detour[0]`` m plus ``detour[1]`` times that
    distance were driven between (``path (K,)`` m). The nearest ``most`` of each scan, and of those that lie
    within ``apart`` m of path the nearest only."""
    pairs = np.zeros((len(poses) * most, 2), dtype=np.int64)
    near, distances = np.zeros(len(poses), dtype=np.int64), np.zeros(len(poses))
    count = 0
    for i in range(len(poses)):
        first, candidates = count, 0
        for j in range(i):
            dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
            if dx * dx + dy * dy >= radius * radius:
                continue
            distance = np.sqrt(dx * dx + dy * dy)
            if path[i] - path[j] > detour[0] + detour[1] * distance:
                near[candidates], distances[candidates] = j, distance
                candidates += 1
        while count - first < most:
            nearest, least = -1, radius
            for k in range(candidates):
                fresh = distances[k] < least
                for taken in range(first, count):
                    fresh &= abs(path[pairs[taken, 1]] - path[near[k]]) > apart
                if fresh:
                    nearest, least = near[k], distances[k]
            if nearest < 0:
                break
            pairs[count, 0], pairs[count, 1] = i, nearest
            count += 1
    return pairs[:count]


@njit(cache=True)
def compare_pairs(pairs, revisits, lasers, beams, angles, stride, tolerance, gate, prior):
    """For each of ``pairs (P, 2)`` of scans: `misfit`'s shift, expectation and number; and how many points of
    either the other sees too, and looks through, ``(P, 5)``.

    ``lasers (K, 3)`` are the poses of the laser, ``beams (K, B, 5)`` range, point and normal of each beam at
    ``angles (B,)``; every ``stride``-th point is compared. Between passes (``revisits (P,)``) only walls that
    the scan before or after saw too can be looked through: persons and the floor under a tilted laser come
    and go.
    """
    points = np.full((beams.shape[0], (beams.shape[1] + stride - 1) // stride, 2), np.nan)
    solid = points.copy()
    for k in range(len(beams)):
        points[k] = beams[k, ::stride, 1:3]
        for other in (k - 1, k + 1):
            if 0 <= other < len(beams):
                T = _between(lasers[other], lasers[k])
                met = meetings(beams[other, :, 0], angles, points[k], T, tolerance)
                for j in range(len(met)):
                    if met[j] == 1:
                        solid[k, j] = points[k, j]
    out = np.zeros((len(pairs), 5))
    for n in range(len(pairs)):
        a, b = pairs[n]
        T_ab = _between(lasers[a], lasers[b])
        out[n, 0], out[n, 1], out[n, 2] = misfit(
            beams[a, :, 1:], beams[b, ::stride, 1:], angles, T_ab, gate, prior
        )
        walls = solid if revisits[n] else points
        for seer, seen in ((a, b), (b, a)):
            T = _between(lasers[seer], lasers[seen])
            met = meetings(beams[seer, :, 0], angles, walls[seen], T, tolerance)
            out[n, 3] += np.sum(met == 1)
            out[n, 4] += np.sum(met == -1)
    return out


@njit(cache=True)
def _between(T_wa, T_wb):
    c, s = np.cos(T_wa[2]), np.sin(T_wa[2])
    x, y = T_wb[0] - T_wa[0], T_wb[1] - T_wa[1]
    return np.array([c * x + s * y, c * y - s * x, T_wb[2] - T_wa[2]])
