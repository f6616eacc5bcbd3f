"""What is known before two submaps are aligned, and what the alignment answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from slam import se2
from slam.se2 import Array

if TYPE_CHECKING:
    from stitch.alignment.bend import Bend


@dataclass(frozen=True)
class Prior:
    """A guess ``T_a_b (3,)`` of submap b in the frame of a, with covariance ``(3, 3)`` in the right tangent.

    Raises ``ValueError`` for a pose that is not finite or a covariance that is not positive definite.
    """

    T_a_b: Array
    covariance: Array

    def __post_init__(self) -> None:
        if np.shape(self.T_a_b) != (3,) or not np.all(np.isfinite(self.T_a_b)):
            raise ValueError(f"prior: expected a finite pose (3,), got {self.T_a_b}")
        if np.shape(self.covariance) != (3, 3) or not np.all(np.isfinite(self.covariance)):
            raise ValueError("prior: expected a finite covariance (3, 3)")
        if np.linalg.eigvalsh(self.covariance)[0] <= 0.0:
            raise ValueError("prior: expected a positive definite covariance")

    def distance(self, T_a_b: Array, covariance: Array | None = None) -> Array:
        """Squared Mahalanobis distances ``(...)`` of poses ``(..., 3)``, errors taken in b's axes.

        ``covariance (3, 3)``, right tangent, is that of the poses themselves, where they have one.
        """
        error = T_a_b - self.T_a_b
        error[..., 2] = se2.wrap(error[..., 2])
        error[..., :2] = error[..., :2] @ se2.rotation(self.T_a_b[2])  # row vectors: this is Rᵀ t
        information = np.linalg.inv(self.covariance if covariance is None else self.covariance + covariance)
        return np.einsum("...i,ij,...j->...", error, information, error)


@dataclass(frozen=True)
class Alternative:
    """Another alignment that was considered, with its score; ``covariance (3, 3)`` in the right tangent,
    ``belief``, its log-odds, and how b would be bent, where they were worked out; ``scale``: b is enlarged by
    it first."""

    T_a_b: Array
    score: float
    covariance: Array | None = None
    belief: float | None = None
    bend: Bend | None = None
    scale: float = 1.0


@dataclass(frozen=True)
class Stitch:
    """Submap b lies at ``T_a_b (3,)`` in the frame of submap a.

    ``covariance (3, 3)`` in the right tangent, None where the method has none; ``score`` on a scale of the
    method's own, more is better; ``overlap_area`` m² known in both maps; ``agreement``: share of the walls in
    the overlap that both maps have; ``alternatives``: the other candidates, best first; ``belief``: log-odds
    that it is right (`stitch.alignment.acceptance`), None where the method has none; ``bend``: how b must be
    bent to lie on a, where it was asked, ``T_a_b`` being the rigid part; ``scale``: b is enlarged by it
    first, 1 unless its scale was free.
    """

    T_a_b: Array
    covariance: Array | None
    score: float
    overlap_area: float
    agreement: float
    alternatives: tuple[Alternative, ...] = ()
    belief: float | None = None
    bend: Bend | None = None
    scale: float = 1.0


@dataclass(frozen=True)
class NoStitch:
    """The two maps could not be aligned: why not, the best candidate if there was one, and the others."""

    reason: str
    best: Alternative | None = None
    alternatives: tuple[Alternative, ...] = ()
