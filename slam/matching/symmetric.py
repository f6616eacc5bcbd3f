"""Eigenvectors of symmetric 3×3 matrices, without the price of a call to LAPACK."""

from __future__ import annotations

import numpy as np
from numba import njit

SWEEPS = 12
"""More than enough: Jacobi rotations converge quadratically, and five do for three rows."""


@njit(cache=True)
def eigh3(matrix):
    """Eigenvalues ``(3,)`` ascending and eigenvectors in the columns of ``(3, 3)`` (cyclic Jacobi)."""
    a, vectors = 0.5 * (matrix + matrix.T), np.eye(3)
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
                    vectors[k, p], vectors[k, q] = (
                        c * vectors[k, p] - s * vectors[k, q],
                        s * vectors[k, p] + c * vectors[k, q],
                    )
    order = np.argsort(np.diag(a))
    return np.diag(a)[order], vectors[:, order]
