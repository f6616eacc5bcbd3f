"""Settings of the matcher."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from slam.se2 import Array

Method = str
"""A name of `slam.matching.registry`."""
CovarianceMode = Literal["p2l", "joint", "pfister_block"]
Solver = Literal["joint", "alternating"]


@dataclass(frozen=True)
class MatchConfig:
    """Settings of the matcher.

    ``levels`` are correspondence distances m, coarse to fine, each with the stride of the scan's points used
    there (2: every second); ``robust`` the χ² at which a pair's weight has halved; ``mutual`` asks for
    mutual nearest neighbours at the last level; ``oriented`` tells both faces of a thin wall apart; ``fade``
    is the mean information below which a direction fades out (0: never); ``freeze_ratio`` of the strongest
    direction below which one is frozen; ``least_pairs`` the pairs an answer needs; ``sigma`` m weighs ICP's
    pairs; ``length`` m that a radian counts for; ``solver`` is the joint Gauss–Newton step or Pfister's
    alternating one.

    Where the answer found first fits badly, or leaves a direction open, others are tried within
    ``search_shift`` m and ``search_turn`` rad of the guess (0: never): badly means under ``least_share`` of
    the points paired, or a misfit above ``most_misfit``; open means a mean information below
    ``open_direction``. Another answer is taken when its misfit, summed, is less by ``margin``.
    """

    levels: tuple[tuple[float, int], ...] = ((1.0, 2), (0.3, 2), (0.1, 1))
    robust: float = 9.0
    mutual: bool = False
    oriented: bool = True
    fade: float = 0.0
    freeze_ratio: float = 1e-3
    most_iterations: int = 25
    least_pairs: int = 15
    sigma: float = 0.02
    length: float = 2.0
    solver: Solver = "joint"
    search_shift: float = 0.6
    search_turn: float = np.radians(30.0)
    least_share: float = 0.6
    most_misfit: float = 2.5
    open_direction: float = 10.0
    margin: float = 12.0

    def __post_init__(self) -> None:
        if not self.levels or not all(radius > 0.0 and stride >= 1 for radius, stride in self.levels):
            raise ValueError(f"levels: expected (radius > 0, stride >= 1) pairs, got {self.levels}")
        if self.solver not in ("joint", "alternating"):
            raise ValueError(f"solver: expected 'joint' or 'alternating', got {self.solver!r}")

    @cached_property
    def descent(self) -> tuple[Any, ...]:
        """What the descent's kernel reads."""
        return (
            float(self.sigma), float(self.robust), self.mutual, float(self.length), float(self.fade),
            float(self.freeze_ratio), int(self.most_iterations), self.oriented,
        )  # fmt: skip

    @property
    def radius(self) -> float:
        """Correspondence distance [m] of the last level."""
        return self.levels[-1][0]

    @cached_property
    def level_table(self) -> Array:
        """The levels as ``(L, 2)``."""
        return np.array(self.levels, dtype=np.float64)

    @cached_property
    def search(self) -> tuple[float, ...]:
        """What the search's kernel reads."""
        return (
            float(self.search_shift), float(self.search_turn), float(self.least_share),
            float(self.most_misfit), float(self.open_direction), float(self.margin),
        )  # fmt: skip


RAW_WSM = MatchConfig(
    levels=((0.5, 1),),
    robust=np.inf,
    mutual=True,
    freeze_ratio=0.0,
    most_iterations=80,
    least_pairs=1,
    solver="alternating",
    search_shift=0.0,
)
"""The Weighted Scan Matcher as UsarCommander has it: Pfister's alternating solution from mutual nearest
neighbours within half a metre, and nothing of ours but the tangents."""
