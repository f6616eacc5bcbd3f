"""Kernels that read the surface off neighbouring beams: tangents, normals and point covariances.

Pfister et al., "Weighted range sensor matching algorithms for mobile robot displacement estimation"
(2002), names the error sources; tangents come from principal axes rather than from two neighbours, whose
noise at short range invents information. The settings are those of `slam.scan.ScanConfig`.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def _distance(points, i, j):
    return np.hypot(points[i, 0] - points[j, 0], points[i, 1] - points[j, 1])


@njit(cache=True)
def losses(ranges):
    """Share of the beams of a scan that did not return, and how far they are lost one by one: the share lost
    after one that returned, over the share lost of all. That is 1 where each is lost by chance, small where
    neighbours see nothing together, 0 where none is lost."""
    before = after = 0
    for i in range(len(ranges) - 1):
        if np.isfinite(ranges[i]):
            before += 1
            after += not np.isfinite(ranges[i + 1])
    lost = np.sum(~np.isfinite(ranges)) / len(ranges)
    return lost, (after / (before * lost) if after > 0 else 0.0)


@njit(cache=True)
def _window(points, centre, radius, side, most, bridging):
    """Last index of the run of neighbours within ``radius`` of ``centre`` on a side (+1 or -1), among the
    next ``most`` beams. A beam without return ends it, or is passed over where ``bridging``."""
    last = following = centre
    while True:
        following += side
        if following < 0 or following >= len(points) or abs(following - centre) > most:
            return last
        if not np.isfinite(points[following, 0]):
            if not bridging:
                return last
            continue
        if _distance(points, following, last) > radius or _distance(points, following, centre) > radius:
            return last
        last = following


@njit(cache=True)
def _principal_axis(points, first, last):
    """Direction [rad] of the points ``first..last``, their scatter along it [m²], the rms across it [m] and
    their number; rows of NaN are none."""
    n = 0
    for i in range(first, last + 1):
        n += np.isfinite(points[i, 0])
    mx = my = 0.0
    for i in range(first, last + 1):
        if np.isfinite(points[i, 0]):
            mx += points[i, 0] / n
            my += points[i, 1] / n
    sxx = sxy = syy = 0.0
    for i in range(first, last + 1):
        if not np.isfinite(points[i, 0]):
            continue
        dx, dy = points[i, 0] - mx, points[i, 1] - my
        sxx += dx * dx
        sxy += dx * dy
        syy += dy * dy
    spread = np.sqrt(0.25 * (sxx - syy) ** 2 + sxy * sxy)
    middle = 0.5 * (sxx + syy)
    across = max(middle - spread, 0.0)
    return 0.5 * np.arctan2(2.0 * sxy, sxx - syy), middle + spread, np.sqrt(across / n), n


@njit(cache=True)
def tangents_of_beams(points, spacing, radius, sigma, most, bridging):
    """Tangent direction and its standard deviation for each beam's point, both ``(B,)`` rad, NaN if
    untrusted.

    ``points (B, 2)`` m in beam order with NaN rows, ``spacing (B,)`` m to the next beam on a surface seen
    at right angles, ``radius`` m of the neighbourhood of at most ``most`` beams to either side, ``sigma`` m
    range noise; ``bridging`` passes over beams without return. Where it is no line (rms across above three
    sigma) half the radius is tried, then given up.
    """
    direction = np.full(len(points), np.nan)
    deviation = np.full(len(points), np.nan)
    for i in range(len(points)):
        if not np.isfinite(points[i, 0]):
            continue
        reach = max(radius, 2.5 * spacing[i])
        for _ in range(2):
            first = _window(points, i, reach, -1, most, bridging)
            last = _window(points, i, reach, 1, most, bridging)
            angle, along, rms, count = _principal_axis(points, first, last)
            if count < 3:
                break
            if rms <= 3.0 * sigma:
                direction[i] = angle
                deviation[i] = max(sigma, rms) / np.sqrt(along)
                break
            reach *= 0.5
    return direction, deviation


@njit(cache=True)
def offsets_from_lines(points, direction, sigma, same_line, same_direction, most, bridging):
    """How far ``(B,)`` m each point lies off the line of its neighbours, along the line's left normal; 0
    without a tangent.

    ``points (B, 2)`` m in beam order with NaN rows, ``direction (B,)`` rad of the tangents. Neighbours lie
    within ``same_line`` m and three ``sigma`` m of the line, their cosine is above ``same_direction``.
    """
    offsets = np.zeros(len(points))
    for i in range(len(points)):
        if not np.isfinite(direction[i]):
            continue
        nx, ny = -np.sin(direction[i]), np.cos(direction[i])
        total, count = 0.0, 0
        first = _window(points, i, same_line, -1, most, bridging)
        last = _window(points, i, same_line, 1, most, bridging)
        for j in range(first, last + 1):
            off = nx * (points[j, 0] - points[i, 0]) + ny * (points[j, 1] - points[i, 1])
            if abs(np.cos(direction[j] - direction[i])) > same_direction and abs(off) < 3.0 * sigma:
                total += off
                count += 1
        offsets[i] = -total / count
    return offsets


@njit(cache=True)
def correspondence_variance(distance, incidence, spacing_angle):
    """Variance [m²] along the surface of the offset between two samplings of it.

    Uniform offset over the neighbouring gaps δ± = l sin β / sin(α ∓ β); the grazing angle α is clamped at 2β,
    where δ+ is still finite.
    """
    alpha = max(incidence, 2.0 * spacing_angle)
    before = distance * np.sin(spacing_angle) / np.sin(alpha + spacing_angle)
    after = distance * np.sin(spacing_angle) / np.sin(alpha - spacing_angle)
    return (after**3 + before**3) / (3.0 * (after + before))


@njit(cache=True)
def point_covariances(ranges, angles, direction, spacing_angle, sigma_range, sigma_angle, incidence):
    """Covariances ``(B, 2, 2)`` m² in the laser frame: measurement plus correspondence error (Pfister
    2002); of a point without tangent that of the grazing angle ``incidence`` rad, in all directions."""
    covariance = np.full((len(ranges), 2, 2), np.nan)
    for i in range(len(ranges)):
        if not np.isfinite(ranges[i]):
            continue
        c, s = np.cos(angles[i]), np.sin(angles[i])
        along, across = sigma_range**2, (ranges[i] * sigma_angle) ** 2
        xx = along * c * c + across * s * s
        xy = (along - across) * c * s
        yy = along * s * s + across * c * c
        if np.isfinite(direction[i]):
            turn = abs(np.sin(angles[i] - direction[i]))
            variance = correspondence_variance(ranges[i], np.arcsin(min(turn, 1.0)), spacing_angle)
            tc, ts = np.cos(direction[i]), np.sin(direction[i])
            xx += variance * tc * tc
            xy += variance * tc * ts
            yy += variance * ts * ts
        else:
            variance = correspondence_variance(ranges[i], incidence, spacing_angle)
            xx += variance
            yy += variance
        covariance[i, 0, 0] = xx
        covariance[i, 0, 1] = covariance[i, 1, 0] = xy
        covariance[i, 1, 1] = yy
    return covariance


@njit(cache=True)
def read_surfaces(
    ranges, angles, spacing_angle, sigma_range, sigma_angle, neighbourhood, least_losses, same, incidence
):
    """Tangent directions and their deviations ``(N, B)`` rad, distances from the neighbours' line ``(N, B)``
    m and point covariances ``(N, B, 2, 2)`` m² of N scans ``ranges (N, B)`` m.

    ``neighbourhood`` is its radius and beams, ``least_losses`` the `losses` from which lost beams are passed
    over, ``same`` the distance and cosine of a common line.
    """
    radius, most = neighbourhood
    shape = ranges.shape
    direction, deviation, offset = np.empty(shape), np.empty(shape), np.empty(shape)
    covariance = np.empty((shape[0], shape[1], 2, 2))
    points = np.empty((shape[1], 2))
    for k in range(shape[0]):
        for i in range(shape[1]):
            points[i, 0] = ranges[k, i] * np.cos(angles[i])
            points[i, 1] = ranges[k, i] * np.sin(angles[i])
        spacing = ranges[k] * spacing_angle
        lost, independence = losses(ranges[k])
        bridging = lost >= least_losses[0] and independence >= least_losses[1]
        direction[k], deviation[k] = tangents_of_beams(points, spacing, radius, sigma_range, most, bridging)
        offset[k] = offsets_from_lines(points, direction[k], sigma_range, same[0], same[1], most, bridging)
        covariance[k] = point_covariances(
            ranges[k], angles, direction[k], spacing_angle, sigma_range, sigma_angle, incidence
        )
    return direction, deviation, offset, covariance
