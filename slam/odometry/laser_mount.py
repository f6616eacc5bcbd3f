"""Where the laser sits on the robot, as the drive itself tells: hand-eye calibration.

A log may put the laser at the robot's origin because nobody measured where it is. But odometry counts the
motion of the wheels' middle along the robot's axes, and a matcher that of the laser along the laser's: a yaw
of the laser turns every step, and where the robot turns, the two differ by the lever between them (Censi,
Marchionni & Oriolo 2013, simultaneous calibration of odometry and sensor parameters).

A tracker that expects the steps in the wrong direction loses its way with a laser that looks sideways or
backwards. Then the laser alone tracks once. The mount that either track tells is assumed in a further one,
whose estimate counts: by then dead reckoning pulls the matches nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from slam import se2
from slam.odometry.mending import MendingConfig, mend
from slam.odometry.recovering_tracker import is_contradicted
from slam.odometry.track import Track, Verdict
from slam.odometry.tracker import FrontendConfig, track
from slam.recording import Recording
from slam.se2 import Array

ROUNDS = 20
"""Iterations of the reweighted least squares."""
LEAST_SPREAD = 1e-6
"""Metres that residuals scatter by at least: made drives may fit to the last bit."""
RIDGE = 1e-9
"""Keeps the normal equations of a drive that never turns, or never drives, solvable."""


@dataclass(frozen=True)
class LaserMountConfig:
    """When a mount is estimated, and when the estimate is believed."""

    estimate: bool = True
    """Whether the mount is estimated where nobody states it."""
    min_steps: int = 50
    """Steps that it takes."""
    min_motion: float = 0.02
    """A step ends where the robot has driven or turned by more [m or rad]."""
    max_match_sigma: float = 0.01
    """A match that knows its place worse [m] tells nothing: along a bare corridor it repeats what dead
    reckoning said."""
    cauchy: float = 2.0
    """Residuals of so many standard deviations count half."""
    correlated: int = 2
    """Steps whose errors may hang together: two in a row share the scan between them."""
    max_sigma: float = 0.01
    """Largest standard deviation [m] of a place that is believed: a drive that hardly turns knows none."""
    max_yaw_sigma: float = np.radians(1.0)
    """Largest standard deviation [rad] of a yaw that is believed."""
    min_distance: float = float(chdtri(3, 0.001))
    """Squared Mahalanobis distance from the robot's origin from which a mount differs from it, χ²₃(0.999)."""
    max_yaw: float = np.radians(20.0)
    """With a laser turned by more [rad] than was assumed, dead reckoning misleads a tracker …"""
    min_matched: float = 0.8
    """… and so it may where a smaller share of the scans is matched: the laser alone tracks then."""
    max_scale: float = 1.5
    """Laser and odometry whose ways differ by a larger factor do not tell of the same drive."""


@dataclass(frozen=True)
class Mount:
    """Pose ``(3,)`` of the laser in the robot's frame (m, m, rad), and its ``covariance (3, 3)``.

    The variances of x and y are infinite where the drive tells the yaw alone.
    """

    T_robot_laser: Array
    covariance: Array

    @property
    def sigma(self) -> Array:
        """Standard deviations ``(3,)`` (m, m, rad)."""
        return np.sqrt(np.diag(self.covariance))

    def __str__(self) -> str:
        (x, y), (sigma_x, sigma_y) = self.T_robot_laser[:2], self.sigma[:2]
        yaw, sigma_yaw = np.degrees([self.T_robot_laser[2], self.sigma[2]])
        place = f"x {x:.3f} ± {sigma_x:.3f} m, y {y:.3f} ± {sigma_y:.3f} m"
        if np.isinf(sigma_x):
            place = "x and y taken as 0 (the drive turns too little to tell)"
        return f"{place}, yaw {yaw:.2f} ± {sigma_yaw:.2f}°"


@dataclass(frozen=True)
class NoMount:
    """The laser stays where the recording puts it, and why."""

    reason: str


STATED = NoMount("it is stated")


def is_mount_unstated(recording: Recording) -> bool:
    """Whether a recording of wheels and laser puts the laser at the robot's origin, and nobody knows better.

    With truth or with the robot's poses from elsewhere the origin has a meaning of its own.
    """
    laser = recording.laser
    at_origin = not laser.mount_stated and not np.any(laser.T_robot_laser)
    return at_origin and recording.source == "odometry" and recording.truth is None


def find_mount(
    recording: Recording,
    frontend: FrontendConfig = FrontendConfig(),
    config: LaserMountConfig = LaserMountConfig(),
    mending: MendingConfig = MendingConfig(),
) -> Mount | NoMount:
    """Where the drive says that its laser sits, if nobody states it; its odometry may lie."""
    if not (config.estimate and is_mount_unstated(recording)):
        return STATED
    two_ways = replace(mending, faults=replace(mending.faults, min_backwards=0))  # a laser may look back
    drive = mend(recording, frontend, two_ways)
    recording, tracked = drive.recording, drive.track
    if drive.faults is None and is_contradicted(recording, tracked, mending.recovery):
        tracked = track(recording, frontend)  # it may be the mount that lies
    first = estimate_mount(recording, tracked, config)
    turned = isinstance(first, Mount) and abs(first.T_robot_laser[2]) > config.max_yaw
    if turned or tracked.matched_share < config.min_matched:
        first = estimate_mount(recording, track(recording.without_dead_reckoning(), frontend), config)
    return _refined(recording, first, frontend, config) if isinstance(first, Mount) else first


def _refined(
    recording: Recording, first: Mount, frontend: FrontendConfig, config: LaserMountConfig
) -> Mount | NoMount:
    """The estimate from a track that assumes the first one; none where they contradict each other."""
    mounted = recording.with_laser_mount(first.T_robot_laser, "the drive")
    tracked = track(mounted, frontend)
    second = estimate_mount(mounted, tracked, config)
    if isinstance(second, NoMount):
        return second
    apart = abs(float(se2.wrap(second.T_robot_laser[2] - first.T_robot_laser[2])))
    if apart > config.max_yaw or tracked.matched_share < config.min_matched:
        yaws = np.degrees([first.T_robot_laser[2], second.T_robot_laser[2]])
        return NoMount(f"the drive contradicts itself (yaw {yaws[0]:.0f}°, then {yaws[1]:.0f}°)")
    return second


def estimate_mount(
    recording: Recording, track: Track, config: LaserMountConfig = LaserMountConfig()
) -> Mount | NoMount:
    """The mount that makes the matched steps of a track agree best with the odometry.

    ``track`` is what a front end makes of the recording with the laser mounted as the recording has it.
    """
    moved_laser, moved_robot = _steps(recording, track, config)
    if len(moved_robot) < config.min_steps:
        seen = f"the robot moved and the laser saw how far in {len(moved_robot)} steps"
        return NoMount(f"{seen}, expected {config.min_steps}")
    if moved_laser[:, 2] @ moved_robot[:, 2] < -0.5 * np.sum(moved_robot[:, 2] ** 2):
        return NoMount("the laser turns against the odometry: is it mounted upside down?")
    rows, sides = _equations(moved_laser, moved_robot)
    solution, covariance = _solve(rows, sides, config)
    scale, mount, covariance = _mount_of(solution, covariance)
    return _judged(scale, mount, covariance, config)


def _judged(scale: float, mount: Array, covariance: Array, config: LaserMountConfig) -> Mount | NoMount:
    """What of an estimate is believed: all of it, the yaw alone, or nothing."""
    *sigma, sigma_yaw = np.sqrt(np.diag(covariance))
    if sigma_yaw > config.max_yaw_sigma:
        return NoMount(f"the drive leaves the laser's yaw uncertain by {np.degrees(sigma_yaw):.1f}°")
    if not 1.0 / config.max_scale < scale < config.max_scale:
        return NoMount(f"the laser sees {scale:.2f} times the way that the odometry counts")
    if max(sigma) > config.max_sigma:
        if mount[2] ** 2 < config.min_distance * sigma_yaw**2:
            return NoMount("the drive turns too little to tell, and agrees with a yaw of 0")
        return Mount(np.array([0.0, 0.0, mount[2]]), np.diag([np.inf, np.inf, sigma_yaw**2]))
    if mount @ np.linalg.solve(covariance, mount) < config.min_distance:
        return NoMount("the drive agrees with a laser at the robot's origin")
    return Mount(mount, covariance)


def _steps(recording: Recording, track: Track, config: LaserMountConfig) -> tuple[Array, Array]:
    """Relative poses ``(n, 3)`` between scans that were matched well, of laser and robot."""
    poses = recording.dead_reckoning
    seen = (track.verdict == Verdict.MATCHED) & (track.place_sigma < config.max_match_sigma)
    pairs, anchor = [], 0
    for k in range(1, len(track)):
        if track.verdict[k] == Verdict.SKIPPED:
            continue
        if not seen[k]:
            anchor = -1
        elif anchor < 0:
            anchor = k
        elif np.hypot(*(poses[k] - poses[anchor])[:2]) > config.min_motion or (
            abs(se2.wrap(poses[k, 2] - poses[anchor, 2])) > config.min_motion
        ):
            pairs.append((anchor, k))
            anchor = k
    before, after = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    laser = se2.compose(track.poses, recording.laser.T_robot_laser)
    return se2.between(laser[before], laser[after]), se2.between(poses[before], poses[after])


def _equations(moved_laser: Array, moved_robot: Array) -> tuple[Array, Array]:
    """Rows ``(n, 2, 4)`` and right sides ``(n, 2)`` of what is linear in the mount, whatever its yaw.

    ``t_laser = (1 + scale) R(−yaw) t_robot + (R(turn) − 1) lever``, where ``lever = R(−yaw) m`` is the
    mount's place m in the laser's axes. The unknowns are the lever, and the sine and cosine − 1 of the yaw,
    which ``1 + scale`` stretches. The turn is the matched one, which is the better known.
    """
    cosine, sine = np.cos(moved_laser[:, 2]) - 1.0, np.sin(moved_laser[:, 2])
    x, y = moved_robot[:, 0], moved_robot[:, 1]
    rows = np.stack([np.stack([cosine, -sine, y, x], -1), np.stack([sine, cosine, -x, y], -1)], axis=1)
    return rows, moved_laser[:, :2] - moved_robot[:, :2]


def _solve(rows: Array, sides: Array, config: LaserMountConfig) -> tuple[Array, Array]:
    """Solution ``(4,)`` by least squares with a Cauchy weight per step, and its covariance ``(4, 4)``: what
    the residuals themselves say, whatever they are distributed like (the sandwich of an M-estimator)."""
    weight = np.ones(len(rows))
    for _ in range(ROUNDS):
        normal = np.einsum("n,nij,nik->jk", weight, rows, rows) + RIDGE * np.eye(4)
        solution = np.linalg.solve(normal, np.einsum("n,nij,ni->j", weight, rows, sides))
        residual = sides - rows @ solution
        spread = max(1.4826 * float(np.median(np.abs(residual))), LEAST_SPREAD)
        square = np.sum(residual**2, axis=1) / (config.cauchy * spread) ** 2
        weight = 1.0 / (1.0 + square)
    pulls = np.einsum("n,nij,ni->nj", weight, rows, residual)
    bent = pulls / (config.cauchy * spread)
    curvature = np.einsum("n,nij,nik->jk", weight, rows, rows) - 2.0 * bent.T @ bent + RIDGE * np.eye(4)
    inverse = np.linalg.inv(curvature)
    noise = _long_run_covariance(pulls, config.correlated) + LEAST_SPREAD**2 * curvature
    return solution, inverse @ noise @ inverse


def _long_run_covariance(pulls: Array, lags: int) -> Array:
    """Covariance ``(4, 4)`` of the sum of ``pulls (n, 4)``, each correlated with the ``lags`` next ones
    (Newey & West 1987)."""
    total = pulls.T @ pulls
    for lag in range(1, lags + 1):
        together = pulls[lag:].T @ pulls[:-lag]
        total = total + (1.0 - lag / (lags + 1.0)) * (together + together.T)
    return total


def _mount_of(solution: Array, covariance: Array) -> tuple[float, Array, Array]:
    """Stretch ``1 + scale``, mount ``(3,)`` and its covariance ``(3, 3)``, from the unknowns ``(4,)``."""
    sine, cosine = solution[2], 1.0 + solution[3]
    stretch, yaw = float(np.hypot(sine, cosine)), float(np.arctan2(sine, cosine))
    place = se2.rotation(yaw) @ solution[:2]
    by_yaw = np.array([-place[1], place[0], 1.0])
    jacobian = np.zeros((3, 4))
    jacobian[:2, :2] = se2.rotation(yaw)
    jacobian[:, 2:] = np.outer(by_yaw, [cosine, -sine]) / stretch**2
    return stretch, np.append(place, yaw), jacobian @ covariance @ jacobian.T
