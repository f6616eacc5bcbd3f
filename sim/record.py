"""From a scenario and a seed to a recording: drive the robot, then let laser and INS look at the drive."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, get_args

import numpy as np

from sim import dead_reckoning as reckoning
from sim.dead_reckoning import InertialConfig, OdometryConfig, ShockConfig
from sim.driver import Driver, DriverConfig, Ending
from sim.laser import MovingObstacles, Scanner
from sim.robot import Robot, RobotConfig
from sim.world import World
from slam import se2
from slam.recording import Recording, Source
from slam.se2 import Array

DeadReckoning = Literal["ins", "odometry"]

PHYSICS_STEP = 0.01
"""Seconds per physics step."""
CONTROL_EVERY = 5
"""Physics steps per decision of the driver."""
READING_EVERY = 10
"""Physics steps between two readings of the INS, which is also read at every scan."""


@dataclass(frozen=True)
class Setup:
    """All that a run needs: a world, a route, and who drives it. Raises ``ValueError`` for an unknown dead
    reckoning."""

    world: World
    start: tuple[float, float, float]
    """x, y [m], yaw [rad] in the world."""
    waypoints: Array
    """``(K, 2)`` m."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    scanner: Scanner = field(default_factory=Scanner)
    dead_reckoning: DeadReckoning = "ins"
    """Which of INS and encoders the recording has; with encoders there is no attitude."""
    inertial: InertialConfig = field(default_factory=InertialConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    shock: ShockConfig = field(default_factory=ShockConfig)
    driver: DriverConfig = field(default_factory=DriverConfig)
    scan_interval: float = 0.30
    """Mean time [s] between scans."""
    scan_jitter: float = 0.01
    """Standard deviation [s] of that."""

    def __post_init__(self) -> None:
        if self.dead_reckoning not in get_args(DeadReckoning):
            raise ValueError(
                f"dead reckoning: expected one of {get_args(DeadReckoning)}, got {self.dead_reckoning!r}"
            )

    @property
    def source(self) -> Source:
        """In which frame increments of the dead reckoning hold: USARSim's INS alone has them in the world's.

        A consistent INS turns its position increments by its own yaw, as odometry does.
        """
        usarsim = self.dead_reckoning == "ins" and self.inertial.model == "usarsim"
        return "ins" if usarsim else "odometry"


class Buildable(Protocol):
    """A scenario: a name, and a set-up drawn from a generator."""

    @property
    def name(self) -> str:
        """Name of the recording."""

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw one set-up."""


@dataclass(frozen=True)
class Drive:
    """What happened, at every reading of the sensors of motion; a scan was taken at the ``scan_rows (N,)``.

    ``time (M,)`` s; ``states (M, 6)``: x, y, yaw not wrapped, roll, pitch, height; ``impulse (M,)``: the
    largest N s since the reading before; ``tracks (M, 2)``: m that the left and right track have driven;
    ``movers (N, K, 3)``: poses of debris and people at the scans; ``ending``: why it ended.
    """

    time: Array
    states: Array
    impulse: Array
    tracks: Array
    movers: Array
    scan_rows: np.ndarray
    ending: Ending


@dataclass(frozen=True)
class SimulatedRun:
    """A recording, and what only a simulator knows.

    ``walls (S, 4)`` m: outlines of all that stands still at the laser's height; ``movers (N, K, 3)``: poses
    of the world's debris, then of its people, at the scans; ``tilt (N, 2)``: true roll and pitch rad at the
    scans; ``ending``: why the drive ended; ``setup`` it came from.
    """

    recording: Recording
    walls: Array
    movers: Array
    tilt: Array
    ending: Ending
    setup: Setup


def simulate(scenario: Buildable, seed: int, dead_reckoning: DeadReckoning | None = None) -> SimulatedRun:
    """Simulate a scenario, with its own ``dead_reckoning`` or another.

    The same arguments give the same bytes: every draw comes from one generator, seeded by ``seed`` and the
    scenario's name. Each stage has a stream of its own, so that a change of the laser leaves the drive as it
    was.
    """
    rng = np.random.default_rng([seed, zlib.crc32(scenario.name.encode())])
    building, driving, scanning, drifting = rng.spawn(4)
    setup = scenario.build(building)
    if dead_reckoning is not None:
        setup = replace(setup, dead_reckoning=dead_reckoning)
    return observe(scenario.name, setup, drive(setup, driving), scanning, drifting)


def drive(setup: Setup, rng: np.random.Generator) -> Drive:
    """Drive the route until it is completed or cannot go on."""
    deciding, shaking, timing = rng.spawn(3)
    robot = Robot(setup.world, setup.start, setup.robot)
    driver = Driver(setup.waypoints, setup.driver, deciding)
    next_scan, speeds, step = setup.scan_interval, (0.0, 0.0), 0
    impulse, left, right = 0.0, 0.0, 0.0
    readings, movers, scan_rows = [(0, *robot.state, impulse, left, right)], [robot.movers], [0]
    while True:
        if step % CONTROL_EVERY == 0:
            x, y, yaw, roll, pitch, _ = robot.state
            wanted = driver.command(step * PHYSICS_STEP, (x, y, yaw), (roll, pitch), robot.roughness)
            if isinstance(wanted, str):
                break
            speeds = setup.robot.track_speeds(*wanted)
        robot.step(*speeds, PHYSICS_STEP, shaking)
        step += 1
        left, right = left + speeds[0] * PHYSICS_STEP, right + speeds[1] * PHYSICS_STEP
        impulse = max(impulse, robot.impulse)
        scanning = step * PHYSICS_STEP >= next_scan
        if scanning:
            next_scan += setup.scan_interval + setup.scan_jitter * timing.standard_normal()
            scan_rows.append(len(readings))
            movers.append(robot.movers)
        if scanning or step % READING_EVERY == 0:
            readings.append((step, *robot.state, impulse, left, right))
            impulse = 0.0
    steps, states, impulses, tracks = np.split(np.array(readings), [1, 7, 8], axis=1)
    return Drive(
        time=PHYSICS_STEP * steps[:, 0],
        states=np.ascontiguousarray(states),
        impulse=impulses[:, 0].copy(),
        tracks=np.ascontiguousarray(tracks),
        movers=np.array(movers).reshape(len(scan_rows), -1, 3),
        scan_rows=np.array(scan_rows),
        ending=wanted,
    )


def observe(
    name: str, setup: Setup, driven: Drive, scanning: np.random.Generator, drifting: np.random.Generator
) -> SimulatedRun:
    """What laser, and INS or encoders, say about a drive."""
    rows = driven.scan_rows
    seen = driven.states[rows]
    world, scanner = setup.world, setup.scanner
    movers = None
    if driven.movers.size:
        movers = MovingObstacles.on_ground(world.movers, driven.movers, world.terrain)
    ranges = scanner.scan(scanner.caster(world), seen, scanning, movers, world.smoke)
    reckoned, tilt = _reckon(setup, driven, drifting)
    recording = Recording(
        name=name,
        time=driven.time[rows],
        ranges=ranges,
        angles=scanner.angles,
        laser=scanner.laser,
        dead_reckoning=_wrapped(reckoned[rows]),
        source=setup.source,
        attitude=None if tilt is None else se2.wrap(tilt[rows]),
        truth=_wrapped(seen[:, :3]),
    )
    walls = world.outlines(scanner.height)
    return SimulatedRun(recording, walls, driven.movers, seen[:, 3:5], driven.ending, setup)


def _reckon(setup: Setup, driven: Drive, rng: np.random.Generator) -> tuple[Array, Array | None]:
    """Dead reckoning ``(M, 3)`` and, where an INS is aboard, attitude ``(M, 2)`` at every reading."""
    shocking, drifting, tilting, slipping = rng.spawn(4)
    time, truth, tilt = driven.time, driven.states[:, :3], driven.states[:, 3:5]
    if setup.dead_reckoning == "odometry":
        tracks, gauge, config = driven.tracks, setup.robot.width, setup.odometry
        return reckoning.wheel_odometry(truth[0], tracks, tilt, time, gauge, config, slipping), None
    jumps = reckoning.shocks(time, driven.impulse, setup.shock, shocking)
    ins = reckoning.ins_poses(truth, time, jumps[:, 0], setup.inertial, drifting)
    return ins, reckoning.attitude(tilt, jumps[:, 1], setup.inertial, tilting)


def _wrapped(poses: Array) -> Array:
    return np.column_stack([poses[:, :2], se2.wrap(poses[:, 2])])
