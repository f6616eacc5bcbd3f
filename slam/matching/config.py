"""Settings of the matcher."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from slam.se2 import Array

Method = str
"""A name in `slam.matching.match.MATCHERS`."""
CovarianceMode = Literal["p2l", "joint", "pfister_block"]
COVARIANCE_MODES: tuple[CovarianceMode, ...] = get_args(CovarianceMode)
Solver = Literal["joint", "alternating"]

WSM, ICP, PLICP = 0, 1, 2
"""Weight of a pair of points: inverse of both points' covariances (Pfister 2002), constant, or along the
reference's normal only."""


@dataclass(frozen=True)
class MatchConfig:
    """Settings of `slam.matching.match`, for the matchers wsm, icp and plicp.

    Raises ``ValueError`` for levels without radius or stride and for an unknown solver.
    """

    levels: tuple[tuple[float, int], ...] = ((1.0, 2), (0.3, 2), (0.1, 1))
    """Correspondence distances [m], coarse to fine, each with the stride of the scan's points (2: every
    second)."""
    robust: float = 9.0
    """χ² at which the Cauchy kernel has halved a pair's weight."""
    mutual: bool = False
    """Whether pairs of the last level must be nearest neighbours of each other."""
    oriented: bool = True
    """Whether both faces of a thin wall are told apart by the side their normals point to."""
    same_side: float = 0.7
    """Cosine between two normals above which points may lie on one surface: 45°."""
    fade: float = 0.0
    """Mean information per weight below which a direction fades out of the answer; 0: never."""
    freeze_ratio: float = 1e-3
    """Share of the strongest direction's information below which a direction is not moved along."""
    most_iterations: int = 25
    """Most Gauss-Newton steps of a level."""
    last_step: float = 1e-4
    """Step [m, rad] at which the last level ends."""
    converged_step: float = 5e-3
    """Step [m, rad] below which a pose that still flickers between two sets of pairs counts as converged."""
    coarse_step: float = 2e-2
    """Step [m, rad] at which a coarse level gives way to the next."""
    least_pairs: int = 15
    """Pairs that an answer needs."""
    sigma: float = 0.02
    """Standard deviation [m] of icp's pairs."""
    length: float = 2.0
    """Metres that a radian counts for where directions are compared."""
    least_information: float = 1.0
    """Floor of the information's eigenvalues [1/m², 1/rad²]: no direction is worse than 1 m or 1 rad."""
    solver: Solver = "joint"
    """Gauss-Newton steps of the whole pose, or Pfister's alternating translation and rotation."""
    misfit_cap: float = 9.0
    """χ² at which a point's misfit is cut; half of it for a point without a partner."""
    search_shift: float = 0.6
    """Metres around the guess in which other answers are looked for; 0: none are."""
    search_turn: float = np.radians(30.0)
    """Radians around the guess in which other answers are looked for."""
    prior_sigmas: float = 4.0
    """Standard deviations of the prior that the search stays within."""
    least_share: float = 0.6
    """Share of the points paired below which the correlative search is run."""
    most_misfit: float = 2.5
    """Mean misfit (χ²) above which the correlative search is run."""
    open_direction: float = 10.0
    """Mean information [1/m²] of a pair below which a direction is open, and starts along it are tried."""
    margin: float = 12.0
    """Summed misfit by which another answer must be better to be taken."""
    correlated_points: float = 10.0
    """Points that share one error: differences of summed misfits are divided by it where answers are weighed
    against each other."""
    search_cell: float = 0.1
    """Cell and step [m] of the correlative search."""
    search_angle: float = np.radians(2.0)
    """Step [rad] of the correlative search."""
    search_range: float = 40.0
    """Range [m] beyond which points are not searched with: the raster grows with its square."""
    search_spacing: float = 0.1
    """Distance [m] between the points that are searched with."""
    search_points: int = 90
    """About the most points that are searched with."""
    candidates: int = 5
    """Peaks of the correlative search that are followed up."""
    apart_cells: int = 2
    """Steps of `search_cell` around a peak within which no other is one."""
    apart_angles: int = 3
    """Steps of `search_angle` around a peak within which no other is one."""
    open_step: float = 0.1
    """Distance [m, or rad times `length`] between starts along an open direction."""
    open_steps: int = 4
    """Most starts to either side along an open direction."""
    same_scan: float = 1e-3
    """Misfit below which a scan is the reference seen again, noise and all: the robot stood still."""

    def __post_init__(self) -> None:
        if not self.levels or not all(radius > 0.0 and stride >= 1 for radius, stride in self.levels):
            raise ValueError(f"levels: expected (radius > 0, stride >= 1) pairs, got {self.levels}")
        if self.solver not in get_args(Solver):
            raise ValueError(f"solver: expected 'joint' or 'alternating', got {self.solver!r}")

    @property
    def radius(self) -> float:
        """Correspondence distance [m] of the last level."""
        return self.levels[-1][0]

    @cached_property
    def level_table(self) -> Array:
        """The levels as ``(L, 2)``."""
        return np.array(self.levels, dtype=np.float64)

    @cached_property
    def kernel_settings(self) -> Any:
        """The `KernelSettings` of the numba kernels, each with the type of its default."""
        values = (getattr(self, name) for name in _KERNEL_FIELDS)
        types = (bool if t == "bool" else int if t == "int" else float for t in _KERNEL_FIELDS.values())
        return KernelSettings(*(convert(value) for convert, value in zip(types, values, strict=True)))


_KERNEL_FIELDS = {f.name: f.type for f in fields(MatchConfig) if f.name not in ("levels", "solver")}
KernelSettings: Any = namedtuple("KernelSettings", _KERNEL_FIELDS)  # type: ignore[misc]
"""The scalars of `MatchConfig` as the numba kernels read them."""

DEFAULT = MatchConfig()

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
