"""Numba kernels of `slam.graph.gauss_newton`: the cost of a pose graph, and its normal equations."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.se2 import Array

Edges = tuple[np.ndarray, Array, Array, Array, Array]
"""Nodes ``(E, 2)``, measured relative poses ``(E, 3)``, information ``(E, 3, 3)``, weights ``(E,)`` and the
squares ``(E,)`` of the scales of Cauchy kernels, infinite where the errors are normal."""

Steps = tuple[np.ndarray, Array, Array]
"""Nodes ``(W, 2)``, displacements ``(W, 2)`` and variances ``(W,)`` of an INS's steps in its world frame."""

Pin = tuple[Array, Array]
"""Prior of node 0: its pose ``(3,)``, and the information ``(3,)`` of its axes."""


@njit(cache=True)
def _between(a: Array, b: Array) -> tuple[float, float, float]:
    """Pose b seen from a; its yaw is not wrapped."""
    c, s = np.cos(a[2]), np.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, c * dy - s * dx, b[2] - a[2]


@njit(cache=True)
def _residual(measured: Array, x: float, y: float, yaw: float) -> Array:
    """Tangent ``(3,)`` that leads from the measured pose to (x, y, yaw)."""
    c, s = np.cos(measured[2]), np.sin(measured[2])
    dx, dy = x - measured[0], y - measured[1]
    along, across = c * dx + s * dy, c * dy - s * dx
    turn = (yaw - measured[2] + np.pi) % (2.0 * np.pi) - np.pi
    if abs(turn) < 1e-4:
        sinc, cosc = 1.0 - turn**2 / 6.0, turn / 2.0 - turn**3 / 24.0
    else:
        sinc, cosc = np.sin(turn) / turn, (1.0 - np.cos(turn)) / turn
    scale = 1.0 / (sinc**2 + cosc**2)
    return np.array([scale * (sinc * along + cosc * across), scale * (sinc * across - cosc * along), turn])


@njit(cache=True)
def _log_derivative(r: Array) -> Array:
    """Derivative ``(3, 3)`` of the tangent ``r`` of a pose by a further one in its body (Chirikjian 2012)."""
    half = 0.5 * r[2]
    if abs(r[2]) < 1e-4:
        cotangent, rest = 1.0 - r[2] ** 2 / 12.0, r[2] / 12.0
    else:
        cotangent = half / np.tan(half)
        rest = (1.0 - cotangent) / r[2]
    D = np.zeros((3, 3))
    D[0, 0], D[0, 1], D[0, 2] = cotangent, -half, rest * r[0] + 0.5 * r[1]
    D[1, 0], D[1, 1], D[1, 2] = half, cotangent, rest * r[1] - 0.5 * r[0]
    D[2, 2] = 1.0
    return D


@njit(cache=True)
def _squared(information: Array, r: Array) -> float:
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += r[a] * information[a, b] * r[b]
    return total


@njit(cache=True)
def cost_of(poses: Array, edges: Edges, steps: Steps, pin: Pin) -> float:
    """Half the weighted sum of squared normalised residuals at ``poses (K, 3)``."""
    total = 0.0
    for e in range(len(edges[3])):
        x, y, yaw = _between(poses[edges[0][e, 0]], poses[edges[0][e, 1]])
        squared, scale = _squared(edges[2][e], _residual(edges[1][e], x, y, yaw)), edges[4][e]
        total += edges[3][e] * (squared if np.isinf(scale) else scale * np.log1p(squared / scale))
    for w in range(len(steps[2])):
        i, j = steps[0][w]
        for axis in range(2):
            total += (poses[j, axis] - poses[i, axis] - steps[1][w, axis]) ** 2 / steps[2][w]
    r = _residual(pin[0], poses[0, 0], poses[0, 1], poses[0, 2])
    for axis in range(3):
        total += pin[1][axis] * r[axis] ** 2
    return 0.5 * total


@njit(cache=True)
def _add(a: Array, b: Array, information: Array, r: Array, out: Array, gradient: Array) -> None:
    """``out += aᵀ information b`` and ``gradient += aᵀ information r``."""
    for row in range(3):
        for k in range(3):
            left = (
                a[0, row] * information[0, k] + a[1, row] * information[1, k] + a[2, row] * information[2, k]
            )
            gradient[row] += left * r[k]
            for column in range(3):
                out[row, column] += left * b[k, column]


@njit(cache=True)
def _add_pair(
    i: int,
    j: int,
    block: int,
    A: Array,
    information: Array,
    r: Array,
    blocks: tuple[Array, Array],
    gradient: Array,
) -> None:
    """Add the residual ``r`` between nodes i and j with its derivatives ``A (2, 3, 3)`` to the diagonal and
    lower blocks and the gradient."""
    unused = np.zeros(3)
    _add(A[0], A[0], information, r, blocks[0][i], gradient[i])
    _add(A[1], A[1], information, r, blocks[0][j], gradient[j])
    if block >= 0:
        _add(A[0], A[1], information, r, blocks[1][block], unused)
    else:
        _add(A[1], A[0], information, r, blocks[1][-1 - block], unused)


@njit(cache=True)
def normal_equations(
    poses: Array, edges: Edges, steps: Steps, pin: Pin, block_index: np.ndarray, lower_blocks: int
) -> tuple[Array, Array, Array]:
    """Diagonal blocks ``(K, 3, 3)``, lower blocks ``(lower_blocks, 3, 3)`` and gradient ``(K, 3)``.

    ``block_index`` of the edges and then of the INS's steps is `slam.graph.cholesky.Structure.block_index`.
    """
    blocks = np.zeros((len(poses), 3, 3)), np.zeros((lower_blocks, 3, 3))
    gradient, A, r = np.zeros(poses.shape), np.zeros((2, 3, 3)), np.zeros(3)
    for e in range(len(edges[3])):
        i, j = edges[0][e]
        x, y, yaw = _between(poses[i], poses[j])
        r = _residual(edges[1][e], x, y, yaw)
        x, y, yaw = _between(poses[j], poses[i])
        c, s = np.cos(yaw), np.sin(yaw)
        A[1] = _log_derivative(r)
        for row in range(3):
            along, across, turned = A[1, row]
            A[0, row, 0] = -c * along - s * across
            A[0, row, 1] = s * along - c * across
            A[0, row, 2] = x * across - y * along - turned
        weight = edges[3][e] / (1.0 + _squared(edges[2][e], r) / edges[4][e])
        _add_pair(i, j, block_index[e], A, weight * edges[2][e], r, blocks, gradient)
    A[:] = 0.0
    r[2] = 0.0
    for w in range(len(steps[2])):
        i, j = steps[0][w]
        for end in range(2):
            c, s = np.cos(poses[steps[0][w, end], 2]), np.sin(poses[steps[0][w, end], 2])
            sign = 2.0 * end - 1.0
            A[end, 0, 0], A[end, 0, 1], A[end, 1, 0], A[end, 1, 1] = sign * c, -sign * s, sign * s, sign * c
        r[:2] = poses[j, :2] - poses[i, :2] - steps[1][w]
        information = np.diag(np.array([1.0, 1.0, 0.0])) / steps[2][w]
        _add_pair(i, j, block_index[len(edges[3]) + w], A, information, r, blocks, gradient)
    r = _residual(pin[0], poses[0, 0], poses[0, 1], poses[0, 2])
    for axis in range(3):
        blocks[0][0, axis, axis] += pin[1][axis]
        gradient[0, axis] += pin[1][axis] * r[axis]
    return blocks[0], blocks[1], gradient
