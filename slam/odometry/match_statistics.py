"""Statistics of every scan's match, which measures of confidence are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from slam.matching.result import Match
from slam.se2 import Array


@dataclass(frozen=True)
class MatchStatistics:
    """Statistics of N matches; NaN where no match answered.

    ``tried (N,)`` and ``failed (N,)`` bool: a match was attempted, and gave no answer. ``covariance (N, 3,
    3)`` of the step in the body frame of the scan; ``weakest (N,)`` smallest eigenvalue of its scaled
    information; ``matches (N,)`` pairs and ``points (N,)`` of the scan; ``residual_rms (N,)``,
    ``residual_p90 (N,)`` m, ``misfit (N,)`` and ``iterations (N,)`` as in `slam.matching.result.Match`.
    ``matched (N, 3)`` is the match's answer seen from ``origin (N, 3)`` in the map, ``expected (N, 3)`` where
    dead reckoning expected the robot in the map, ``expected_covariance (N, 3, 3)`` of its additive errors.
    ``attitude (N, 2)`` is (roll, pitch) rad as the INS says.
    """

    tried: np.ndarray
    failed: np.ndarray
    covariance: Array
    weakest: Array
    matches: Array
    points: Array
    residual_rms: Array
    residual_p90: Array
    misfit: Array
    iterations: Array
    origin: Array
    matched: Array
    expected: Array
    expected_covariance: Array
    attitude: Array

    @classmethod
    def empty(cls, n: int) -> MatchStatistics:
        """Nothing tried yet of n scans."""
        shapes: dict[str, tuple[int, ...]] = {
            "covariance": (n, 3, 3),
            "origin": (n, 3),
            "matched": (n, 3),
            "expected": (n, 3),
            "expected_covariance": (n, 3, 3),
            "attitude": (n, 2),
        }
        numbers = {f.name: np.full(shapes.get(f.name, (n,)), np.nan) for f in fields(cls)[2:]}
        return cls(np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), **numbers)

    def extended(self, n: int) -> MatchStatistics:
        """The same with room for n scans."""
        room = MatchStatistics.empty(n - len(self.tried))
        return MatchStatistics(
            *(np.concatenate([getattr(e, f.name) for e in (self, room)]) for f in fields(self))
        )

    def __getitem__(self, part: slice) -> MatchStatistics:
        """The statistics of some of the scans."""
        return MatchStatistics(*(getattr(self, f.name)[part] for f in fields(self)))

    def note_failure(self, k: int) -> None:
        """A match of scan k was tried, without an answer."""
        self.tried[k] = self.failed[k] = True

    def note(
        self,
        k: int,
        result: Match,
        points: int,
        attitude: Sequence[float] | Array | None,
        origin: Array,
        expected: Array,
        expected_covariance: Array,
    ) -> None:
        """What the match of scan k, of so many points, left behind; the rest as in the fields."""
        self.tried[k] = True
        self.covariance[k] = result.covariance
        self.weakest[k] = result.information_eigenvalues[0]
        self.matches[k] = result.n_matches
        self.points[k] = points
        self.residual_rms[k] = result.residual_rms
        self.residual_p90[k] = result.residual_p90
        self.misfit[k] = result.misfit
        self.iterations[k] = result.iterations
        self.origin[k] = origin
        self.matched[k] = result.T_reference_scan
        self.expected[k] = expected
        self.expected_covariance[k] = expected_covariance
        if attitude is not None:
            self.attitude[k] = attitude
