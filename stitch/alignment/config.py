"""Settings of an alignment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from stitch.alignment.verification import Acceptance

Method = Literal["joint", "htms", "carpin", "censi", "akaze", "orb"]


@dataclass(frozen=True)
class AlignConfig:
    """How two submaps are aligned.

    ``method`` is ours ("joint"), the report's ("htms", Formsma), Carpin's (2008), Censi's (2005) or that of
    OpenCV's features ("akaze", "orb").

    All methods read ``resolution`` m of the raster. The rest is read by "joint" only, so that tuning ours
    does not move the others: ``n_theta`` directions of the Hough transform, ``n_peaks`` rotations (each with
    its twin); ``search_resolution`` m of the global search, done twice: ``free_penalty`` per wall cell in the
    other's free space finds small overlaps of maps that agree, ``lenient_penalty`` maps that are bent or
    between which things were moved (a cell of a straight wall that coincides scores 3.5); ``blur`` in cells;
    ``prior_weight`` cells per ½ of squared Mahalanobis distance, ``prior_sigmas`` the half width of the
    search around a prior; ``sweep_step`` and ``sweep_limit`` rad where directions cannot be trusted;
    ``candidates`` of each search that are climbed; ``temperature`` cells, the score difference a covariance
    takes for noise; ``warp`` (m, rad) the distortion within a submap of about 30 × 20 m; ``refine`` by the
    scan matcher, which may move by ``refine_limit`` (m, rad).
    """

    method: Method = "joint"
    resolution: float = 0.1
    n_theta: int = 360
    n_peaks: int = 6
    search_resolution: float = 0.2
    free_penalty: float = 40.0
    lenient_penalty: float = 12.0
    blur: float = 1.0
    prior_weight: float = 20.0
    prior_sigmas: float = 3.0
    sweep_step: float = 0.035
    sweep_limit: float = 0.35
    candidates: int = 8
    temperature: float = 2.0
    warp: tuple[float, float] = (0.018, 0.0026)
    refine: bool = True
    refine_limit: tuple[float, float] = (0.3, 0.05)
    acceptance: Acceptance = field(default_factory=Acceptance)

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise ValueError(f"method: expected one of {', '.join(get_args(Method))}, got {self.method!r}")
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
