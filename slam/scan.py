"""One laser scan, or many merged, as points with tangents and covariances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.recording import Laser, Recording
from slam.se2 import Array

BLOCK = 256
"""Scans that are made of their ranges at once: the arithmetic is a fraction of the calls."""


@dataclass(frozen=True)
class ScanConfig:
    """How surfaces and uncertainties are read off the ranges of a scan."""

    neighbourhood: float = 0.3
    """Radius [m] of the points a tangent is fitted to."""
    most_neighbours: int = 12
    """Most beams looked at to either side for that."""
    least_lost: float = 0.1
    """Share of a scan's beams without return from which they may be passed over: fewer do no harm …"""
    least_independence: float = 0.8
    """… if they are lost one by one, not side by side: the share lost after one that returned is at least so
    much of the share of all."""
    same_line: float = 0.15
    """Radius [m] of the points whose common line a point is moved onto …"""
    same_direction: float = 0.985
    """… where the cosine between their tangent and the point's own is larger."""
    least_sigma: float = 0.01
    """Least range noise [m] that points are given: below it uneven walls, a tilt nobody sees and quantisation
    count for more than what the laser's data sheet says."""
    sigma_angle: float = 5e-4
    """Standard deviation [rad] of a beam's direction."""
    no_tangent_incidence: float = np.pi / 8.0
    """Grazing angle [rad] whose correspondence variance a point without a tangent gets, in all directions."""


DEFAULT = ScanConfig()


@dataclass(frozen=True)
class Scan:
    """Points ``(n, 2)`` m in the robot's frame (or a submap's), with what is known of the surface at
    each.

    ``tangents (n, 2)`` unit vectors along the wall, NaN where no tangent can be trusted; ``normals (n,
    2)`` unit vectors towards the sensor, NaN likewise; ``covariance (n, 2, 2)`` m²; ``tangent_sigma
    (n,)`` rad; ``beams (n,)`` index of the beam each point came from.
    """

    points: Array
    tangents: Array
    normals: Array
    covariance: Array
    tangent_sigma: Array
    beams: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def from_ranges(cls, ranges: Array, angles: Array, laser: Laser, config: ScanConfig = DEFAULT) -> Scan:
        """Scan in the robot's frame from ``ranges (B,)`` m (NaN = no return) and ``angles (B,)`` rad.

        Raises ``ValueError`` when the shapes differ.
        """
        ranges, angles = np.asarray(ranges, dtype=np.float64), np.asarray(angles, dtype=np.float64)
        if ranges.shape != angles.shape or ranges.ndim != 1:
            raise ValueError(f"ranges and angles: expected equal (B,), got {ranges.shape} and {angles.shape}")
        return _from_rows(ranges[None], angles, laser, config)[0]

    def to_ranges(self, angles: Array, laser: Laser) -> Array:
        """Ranges ``(B,)`` m along ``angles (B,)`` rad of a scan in the robot's frame, as its points have
        them; NaN for a beam without one. Raises ``ValueError`` for points of beams that there are not."""
        if len(self) and not 0 <= self.beams.min() <= self.beams.max() < len(angles):
            raise ValueError(f"scan: expected points of beams 0..{len(angles) - 1}, got {self.beams.max()}")
        ranges = np.full(len(angles), np.nan)
        in_laser = se2.transform(se2.inverse(laser.T_robot_laser), self.points)
        ranges[self.beams] = np.linalg.norm(in_laser, axis=1)
        return ranges

    @classmethod
    def merged(cls, scans: Sequence[Scan]) -> Scan:
        """All points of several scans that are already in one frame."""
        return cls(*(np.concatenate([getattr(s, name) for s in scans]) for name in cls.__annotations__))

    def transformed(self, T_ab: Array) -> Scan:
        """The scan, given in frame b, in frame a."""
        R = se2.rotation(T_ab[2])
        return Scan(
            se2.transform(T_ab, self.points),
            self.tangents @ R.T,
            self.normals @ R.T,
            R @ self.covariance @ R.T,
            self.tangent_sigma,
            self.beams,
        )

    def selected(self, rows: np.ndarray) -> Scan:
        """The points of the given rows (indices or mask)."""
        return Scan(*(getattr(self, name)[rows] for name in type(self).__annotations__))


def stream(recording: Recording, config: ScanConfig = DEFAULT) -> Iterator[Scan]:
    """Every scan of a recording in the robot's frame, one after the other, a block of them in memory."""
    for start in range(0, len(recording), BLOCK):
        ranges = recording.ranges[start : start + BLOCK]
        yield from _from_rows(ranges, recording.angles, recording.laser, config)


def scans_of(recording: Recording, config: ScanConfig = DEFAULT) -> list[Scan]:
    """Every scan of a recording in the robot's frame."""
    return list(stream(recording, config))


def _from_rows(ranges: Array, angles: Array, laser: Laser, config: ScanConfig) -> list[Scan]:
    """Scans in the robot's frame from ``ranges (N, B)``, all at once."""
    from slam.surface import read_surfaces

    spacing_angle = float(np.median(np.diff(angles))) if len(angles) > 1 else np.pi / 180.0
    direction, tangent_sigma, offset, covariance = read_surfaces(
        ranges,
        angles,
        spacing_angle,
        max(laser.sigma_range, config.least_sigma),
        float(config.sigma_angle),
        (float(config.neighbourhood), int(config.most_neighbours)),
        (float(config.least_lost), float(config.least_independence)),
        (float(config.same_line), float(config.same_direction)),
        float(config.no_tangent_incidence),
    )
    points = ranges[..., None] * np.stack([np.cos(angles), np.sin(angles)], -1)
    tangents = np.stack([np.cos(direction), np.sin(direction)], -1)
    normals = np.stack([-tangents[..., 1], tangents[..., 0]], -1)
    points -= np.where(np.isfinite(normals), offset[..., None] * normals, 0.0)
    normals *= np.where(np.sum(normals * points, axis=-1, keepdims=True) > 0.0, -1.0, 1.0)
    R = se2.rotation(laser.T_robot_laser[2])
    points = se2.transform(laser.T_robot_laser, points)
    tangents, normals, covariance = tangents @ R.T, normals @ R.T, R @ covariance @ R.T
    seen = [np.flatnonzero(row) for row in np.isfinite(ranges)]
    return [
        Scan(points[k, s], tangents[k, s], normals[k, s], covariance[k, s], tangent_sigma[k, s], s)
        for k, s in enumerate(seen)
    ]
