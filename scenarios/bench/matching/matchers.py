"""The matchers that are measured: ours, ours without one of its parts, other people's (extra ``[peers]``).

The others look for partners within 1 m, as ours does at first, use one thread and no voxels, stop by their
own rules, and claim no covariance. For ``small_gicp`` the points are put at three heights, 10 cm apart: a
planar scan has no extent across its plane, so that generalised ICP would become ICP; covariances from 20
neighbours; the answer's x, y and yaw count. Extruding counts as reading the ranges, preprocessing both clouds
(covariances, tree) as part of the match. ``open3d point``: point to point on the planar points, at most 30
iterations, its default.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from scenarios.bench.matching.pairs import Pair
from scenarios.bench.matching.scores import Matcher, PoseEstimate
from slam import se2
from slam.matching import RAW_WSM, LocalMap, Match, MatchConfig, NoMatch, Reference, match
from slam.matching.config import CovarianceMode, Method
from slam.se2 import Array

REACH = 1.0
"""Largest distance [m] between partners."""
LAYERS = 0.1
"""Distance [m] between the three heights of an extruded scan."""
NEIGHBOURS = 20
VOXEL = 1e-3
"""Finer than any two points are apart: no downsampling."""
GICP, PLANE = "small_gicp GICP", "small_gicp plane"
INSTALL = "not installed: pip install 'slamstitch[peers]'"

DEFAULT = MatchConfig()


@dataclass(frozen=True)
class Variant:
    """One way to call `slam.matching.match`."""

    name: str
    method: Method = "plicp"
    covariance: CovarianceMode = "p2l"
    config: MatchConfig = DEFAULT

    @property
    def matcher(self) -> Matcher:
        """The variant as the scores take it."""
        return Matcher(lambda pair, which: pair.scans[which], Reference, self.match)

    def match(self, reference: Reference | LocalMap, scan: Reference, guess: Array) -> Match | NoMatch:
        """A match from a guess ``(3,)``."""
        return match(reference, scan, guess, self.method, self.covariance, config=self.config)


OURS = Variant("plicp")
"""The default, which the others are compared with."""

VARIANTS = (
    OURS,
    Variant("wsm", "wsm"),
    Variant("icp", "icp", "joint"),
    Variant("raw wsm", "wsm", "pfister_block", RAW_WSM),
)


def _without(name: str, **settings: object) -> Variant:
    return replace(OURS, name=f"− {name}", config=replace(OURS.config, **settings))  # type: ignore[arg-type]


ABLATION = (
    _without("coarse to fine", levels=((0.5, 1),)),
    _without("robust weights", robust=np.inf),
    _without("one-way pairs (mutual)", mutual=True),
    _without("oriented normals", oriented=False),
    _without("search where it fits badly", least_share=0.0, most_misfit=np.inf),
    _without("search along open directions", open_direction=-np.inf),
    _without("both searches", search_shift=0.0),
    _without("frozen directions", freeze_ratio=0.0),
    replace(OURS, name="− p2l (joint)", covariance="joint"),
    replace(OURS, name="− p2l (pfister_block)", covariance="pfister_block"),
)
"""The default without one of its parts, each."""


def third_party_matchers() -> tuple[dict[str, Matcher], dict[str, str]]:
    """Matchers by name, and why a package cannot be used by the package."""
    matchers: dict[str, Matcher] = {}
    missing: dict[str, str] = {}
    for package, matchers_of in (("small_gicp", small_gicp_matchers), ("open3d", open3d_matchers)):
        if find_spec(package) is None:
            missing[package] = INSTALL
            continue
        try:
            matchers |= matchers_of(import_module(package))
        except ImportError as error:  # its wheel may need a library that the system lacks
            missing[package] = f"cannot be imported: {error}"
    return matchers, missing


def small_gicp_matchers(small_gicp: Any) -> dict[str, Matcher]:
    """Two matchers of the module ``small_gicp``."""

    def prepare(cloud: Array) -> Any:
        return small_gicp.preprocess_points(cloud, VOXEL, NEIGHBOURS, num_threads=1)

    def matcher(kind: str) -> Matcher:
        """The matcher of one ``registration_type`` of small_gicp."""

        def match(reference: Any, scan: Any, guess: Array) -> PoseEstimate:
            """The scan's pose ``(3,)`` in the frame of the reference, from a guess of it; no covariance."""
            (target, tree), (source, _) = reference, scan
            result = small_gicp.align(
                target, source, tree, to_space(guess),
                registration_type=kind, max_correspondence_distance=REACH, num_threads=1,
            )  # fmt: skip
            return PoseEstimate(to_plane(result.T_target_source), None)

        return Matcher(extruded, prepare, match)

    return {GICP: matcher("GICP"), PLANE: matcher("PLANE_ICP")}


def open3d_matchers(open3d: Any) -> dict[str, Matcher]:
    """One matcher of the module ``open3d``."""
    registration = open3d.pipelines.registration
    point_to_point = registration.TransformationEstimationPointToPoint()

    def read(pair: Pair, which: int) -> Any:
        flat = np.pad(points(pair, which), ((0, 0), (0, 1)))
        return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(flat))

    def match(reference: Any, scan: Any, guess: Array) -> PoseEstimate:
        result = registration.registration_icp(scan, reference, REACH, to_space(guess), point_to_point)
        return PoseEstimate(to_plane(result.transformation), None)

    return {"open3d point": Matcher(read, lambda cloud: cloud, match)}


def extruded(pair: Pair, which: int) -> Array:
    """The points of one of the scans at three heights, ``(3 n, 3)`` m."""
    flat = points(pair, which)
    return np.column_stack([np.tile(flat, (3, 1)), np.repeat([-LAYERS, 0.0, LAYERS], len(flat))])


def points(pair: Pair, which: int) -> Array:
    """The points ``(n, 2)`` m of one of the scans in the robot's frame."""
    ranges = pair.ranges[which]
    seen = np.isfinite(ranges)
    r, a = ranges[seen], pair.angles[seen]
    return se2.transform(pair.laser.T_robot_laser, np.column_stack([r * np.cos(a), r * np.sin(a)]))


def to_space(pose: Array) -> Array:
    """Homogeneous matrix ``(4, 4)`` of a pose ``(3,)`` of the plane."""
    T = np.eye(4)
    T[:2, :2], T[:2, 3] = se2.rotation(pose[2]), pose[:2]
    return T


def to_plane(T: Array) -> Array:
    """What a homogeneous matrix ``(4, 4)`` does in the plane, as a pose ``(3,)``."""
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
