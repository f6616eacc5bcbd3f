"""Settings of an alignment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from stitch.verification import Acceptance


@dataclass(frozen=True)
class AlignConfig:
    """How two submaps are aligned; ``method`` is ours ("joint") or the report's ("htms").

    Both methods: ``resolution`` m of the raster, ``n_theta`` directions of the Hough transform, ``n_peaks``
    rotations (each with its twin). The rest is read by "joint" only: ``search_resolution`` m of the global
    search; ``free_penalty`` per wall cell in the other's free space, 2–3 for warped submaps; ``blur`` in
    cells; ``prior_weight`` cells per ½ of squared Mahalanobis distance, ``prior_sigmas`` the half width of
    the search around a prior; ``sweep_step`` and ``sweep_limit`` rad where directions cannot be trusted;
    ``candidates`` that are climbed; ``temperature`` cells, the score difference a covariance takes for noise;
    ``warp`` (m, rad) the distortion within a submap; ``refine`` by the scan matcher, which may move by
    ``refine_limit`` (m, rad).
    """

    method: Literal["joint", "htms"] = "joint"
    resolution: float = 0.1
    n_theta: int = 360
    n_peaks: int = 4
    search_resolution: float = 0.2
    free_penalty: float = 5.0
    blur: float = 1.0
    prior_weight: float = 20.0
    prior_sigmas: float = 3.0
    sweep_step: float = 0.035
    sweep_limit: float = 0.35
    candidates: int = 5
    temperature: float = 10.0
    warp: tuple[float, float] = (0.02, 0.0052)
    refine: bool = True
    refine_limit: tuple[float, float] = (0.3, 0.05)
    acceptance: Acceptance = field(default_factory=Acceptance)

    def __post_init__(self) -> None:
        if self.method not in ("joint", "htms"):
            raise ValueError(f"method: expected 'joint' or 'htms', got {self.method!r}")
        positive = (
            "resolution",
            "n_theta",
            "n_peaks",
            "search_resolution",
            "candidates",
            "sweep_step",
            "temperature",
        )
        for name in positive:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")
