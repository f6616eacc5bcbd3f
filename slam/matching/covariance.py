"""How sure a match is, three ways (from normals alone, from all of W, and as Pfister's block form), and
how far its pairs are apart."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.config import WSM
from slam.matching.kernels import eigh3, pair_covariance, pair_weight


@njit(cache=True)
def point_to_line_information(reference, scan, pairs, pose, robust, same_side):
    """Information (3, 3) that wall normals alone carry, less what their own noise fabricates.

    Λ = Σ f_nᵀf_n / v − Σ σ_tan² f_tᵀf_t / v with v = nᵀ P n: closed-form covariances that ignore re-matching
    hold for point-to-line only (Bonnabel et al. 2016).
    """
    points, normals, covariance, tangent_sigma = reference
    scan_points, scan_normals, scan_covariance, _ = scan
    information = np.zeros((3, 3))
    across, along = np.empty(3), np.empty(3)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        nx, ny = normals[j]
        mx = c * scan_normals[i, 0] - s * scan_normals[i, 1]
        my = s * scan_normals[i, 0] + c * scan_normals[i, 1]
        if not nx * mx + ny * my > same_side:
            continue
        rx = c * scan_points[i, 0] - s * scan_points[i, 1]
        ry = s * scan_points[i, 0] + c * scan_points[i, 1]
        xx, xy, yy = pair_covariance(covariance[j], scan_covariance[i], c, s)
        v = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
        error = nx * (points[j, 0] - rx - pose[0]) + ny * (points[j, 1] - ry - pose[1])
        v *= 1.0 + error * error / v / robust
        across[0], across[1], across[2] = nx, ny, -nx * ry + ny * rx
        along[0], along[1], along[2] = -ny, nx, ny * ry + nx * rx
        noise = tangent_sigma[j] ** 2
        for a in range(3):
            for b in range(3):
                information[a, b] += (across[a] * across[b] - noise * along[a] * along[b]) / v
    return information


@njit(cache=True)
def pfister_block(reference, scan, pairs, pose):
    """Covariance (3, 3) of additive errors of the pose in Pfister's block form, as UsarCommander has it.

    About the centre of rotation c: P_tt = (ΣW)⁻¹, P_φφ = 1/κ and P_tφ = −(ΣW)⁻¹ ΣWJq / κ with κ = Σ(Jq)ᵀWJq
    and q = p2 − c; then moved from c to the scan's origin. UsarCommander's last loop never advances its
    index, so that all but P_tt is made with the first pair's W, and is often indefinite. NaN without pairs.
    """
    _, normals, covariance, _ = reference
    scan_points, scan_normals, scan_covariance, _ = scan
    c, s = np.cos(pose[2]), np.sin(pose[2])
    A, first_W, WJp = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2)
    count, Jp, JpJp = 0, np.zeros(2), np.zeros((2, 2))
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        pair = pair_covariance(covariance[j], scan_covariance[i], c, s)
        xx, xy, yy = pair_weight(WSM, normals[j], scan_normals[i], pair, c, s, 1.0, True, 0.0)
        W = np.array([[xx, xy], [xy, yy]])
        h = np.array(
            [-s * scan_points[i, 0] - c * scan_points[i, 1], c * scan_points[i, 0] - s * scan_points[i, 1]]
        )
        A += W
        WJp += W @ h
        Jp += h
        JpJp += np.outer(h, h)
        if count == 0:
            first_W = W
        count += 1
    if count == 0 or np.linalg.det(A) <= 0.0:
        return np.full((3, 3), np.nan)
    inverse = np.linalg.inv(A)
    Jc = inverse @ WJp
    Jq = Jp - count * Jc
    kappa = np.sum(first_W * (JpJp - np.outer(Jp, Jc) - np.outer(Jc, Jp) + count * np.outer(Jc, Jc)))
    if kappa == 0.0:
        return np.full((3, 3), np.nan)
    block = np.zeros((3, 3))
    block[:2, :2] = inverse
    block[:2, 2] = -Jq / (count * kappa)  # (n W)⁻¹ W Σ Jq / κ
    block[2, :2] = block[:2, 2]
    block[2, 2] = 1.0 / kappa
    S = np.eye(3)
    S[:2, 2] = -Jc
    return S @ block @ S.T


@njit(cache=True)
def floored_inverse(information, least):
    """Λ⁻¹ with the eigenvalues of Λ floored at ``least``, so that it is positive definite and bounded."""
    values, vectors = eigh3(information)
    return (vectors / np.maximum(values, least)) @ vectors.T


@njit(cache=True)
def body_covariance(mode, reference, scan, pairs, pose, information, prior, spread, settings):
    """Covariance (3, 3) in the body frame of the scan, and the eigenvalues (3,) of the information it is
    made of, with yaw scaled by ``settings.length`` m.

    ``mode`` is an index of `slam.matching.config.COVARIANCE_MODES`; ``information`` is the last Λ of the
    descent, ``prior`` what was known before, ``spread`` that of other answers; all of additive errors.
    """
    if mode == 0:
        information = point_to_line_information(
            reference, scan, pairs, pose, settings.robust, settings.same_side
        )
    covariance = floored_inverse(information + prior, settings.least_information)
    if mode == 2:
        covariance = pfister_block(reference, scan, pairs, pose)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    to_body = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    scale = np.array([1.0, 1.0, 1.0 / settings.length])
    values, _ = eigh3((information + prior) * np.outer(scale, scale))
    return to_body @ (covariance + spread) @ to_body.T, values


@njit(cache=True)
def residual_quantile(reference, scan, pairs, pose, share):
    """Distance [m] that a ``share`` of the pairs does not exceed; NaN without pairs.

    ``reference`` and ``scan`` are clouds, ``pairs (n,)`` the row of the reference's point for each point of
    the scan, -1 for none. Of k pairs it is the ⌈share·k⌉-th smallest distance.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    distances = np.empty(len(pairs))
    count = 0
    for i in range(len(pairs)):
        j = pairs[i]
        if j < 0:
            continue
        x = c * scan[0][i, 0] - s * scan[0][i, 1] + pose[0]
        y = s * scan[0][i, 0] + c * scan[0][i, 1] + pose[1]
        distances[count] = np.hypot(reference[0][j, 0] - x, reference[0][j, 1] - y)
        count += 1
    if count == 0:
        return np.nan
    return np.sort(distances[:count])[max(int(np.ceil(share * count)) - 1, 0)]
