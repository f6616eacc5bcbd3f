"""From a scenario and a seed to a recording: drive the robot, then let laser and INS look at the drive."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sim import inertial
from sim.driver import Driver, DriverConfig, Ending
from sim.inertial import InertialConfig, ShockConfig
from sim.laser import Raycaster, Scanner
from sim.robot import Robot, RobotConfig
from sim.world import World
from slam import se2
from slam.recording import Recording
from slam.se2 import Array

PHYSICS_STEP = 0.01
"""Seconds per physics step."""
CONTROL_EVERY = 5
"""Physics steps per decision of the driver."""
READING_EVERY = 10
"""Physics steps between two readings of the INS, which is also read at every scan."""


@dataclass(frozen=True)
class Setup:
    """All that a run needs: a world, a start ``(x, y, yaw)``, waypoints ``(K, 2)`` m, and who is in it.

    A scan is taken every ``scan_interval`` s, give or take ``scan_jitter`` (standard deviation).
    """

    world: World
    start: tuple[float, float, float]
    waypoints: Array
    robot: RobotConfig = field(default_factory=RobotConfig)
    scanner: Scanner = field(default_factory=Scanner)
    inertial: InertialConfig = field(default_factory=InertialConfig)
    shock: ShockConfig = field(default_factory=ShockConfig)
    driver: DriverConfig = field(default_factory=DriverConfig)
    scan_interval: float = 0.30
    scan_jitter: float = 0.01


class Buildable(Protocol):
    """A scenario: a name, and a set-up drawn from a generator."""

    @property
    def name(self) -> str:
        """Name of the recording."""

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw one set-up."""


@dataclass(frozen=True)
class Drive:
    """What happened, at every INS reading: ``time (M,)`` s, ``states (M, 6)`` (x, y, yaw not wrapped, roll,
    pitch, height), the largest ``impulse (M,)`` N s since the reading before, the rows of the
    readings at which
    a scan was taken, and why it ended.
    """

    time: Array
    states: Array
    impulse: Array
    scan_rows: np.ndarray
    ending: Ending


@dataclass(frozen=True)
class SimulatedRun:
    """A recording, and what only a simulator knows.

    ``walls (S, 4)`` m: outlines of everything at the laser's height; ``tilt (N, 2)``: true roll and pitch
    rad at the scans; ``ending``: why the drive ended; ``setup`` it came from.
    """

    recording: Recording
    walls: Array
    tilt: Array
    ending: Ending
    setup: Setup


def simulate(scenario: Buildable, seed: int) -> SimulatedRun:
    """Simulate a scenario. The same scenario and seed give the same bytes.

    Every draw comes from one generator, seeded by ``seed`` and the scenario's name; each stage has a stream
    of its own, so that a change of the laser leaves the drive as it was.
    """
    rng = np.random.default_rng([seed, zlib.crc32(scenario.name.encode())])
    building, driving, scanning, reckoning = rng.spawn(4)
    setup = scenario.build(building)
    return observe(scenario.name, setup, drive(setup, driving), scanning, reckoning)


def drive(setup: Setup, rng: np.random.Generator) -> Drive:
    """Drive the route until it is completed or cannot go on."""
    deciding, shaking, timing = rng.spawn(3)
    robot = Robot(setup.world, setup.start, setup.robot)
    driver = Driver(setup.waypoints, setup.driver, deciding)
    steps, states, impulses, scan_rows = [0], [robot.state], [0.0], [0]
    next_scan = setup.scan_interval
    impulse, tracks, step = 0.0, (0.0, 0.0), 0
    while True:
        if step % CONTROL_EVERY == 0:
            x, y, yaw, roll, pitch, _ = robot.state
            wanted = driver.command(step * PHYSICS_STEP, (x, y, yaw), (roll, pitch), robot.roughness)
            if isinstance(wanted, str):
                ending = wanted
                break
            tracks = setup.robot.track_speeds(*wanted)
        robot.step(*tracks, PHYSICS_STEP, shaking)
        impulse, step = max(impulse, robot.impulse), step + 1
        scanning = step * PHYSICS_STEP >= next_scan
        if scanning:
            scan_rows.append(len(states))
            next_scan += setup.scan_interval + setup.scan_jitter * timing.standard_normal()
        if scanning or step % READING_EVERY == 0:
            steps.append(step)
            states.append(robot.state)
            impulses.append(impulse)
            impulse = 0.0
    time = PHYSICS_STEP * np.array(steps)
    return Drive(time, np.array(states), np.array(impulses), np.array(scan_rows), ending)


def observe(
    name: str, setup: Setup, driven: Drive, scanning: np.random.Generator, reckoning: np.random.Generator
) -> SimulatedRun:
    """What laser and INS say about a drive."""
    shocking, drifting, tilting = reckoning.spawn(3)
    rows = driven.scan_rows
    seen = driven.states[rows]
    jumps = inertial.shocks(driven.time, driven.impulse, setup.shock, shocking)
    ins = inertial.dead_reckon(driven.states[:, :3], driven.time, jumps[:, 0], setup.inertial, drifting)
    tilt = driven.states[:, 3:5]
    reported = inertial.attitude(tilt, jumps[:, 1], setup.inertial, tilting)
    ranges = setup.scanner.scan(Raycaster(setup.world), seen, scanning)
    recording = Recording(
        name=name,
        time=driven.time[rows],
        ranges=ranges,
        angles=setup.scanner.angles,
        laser=setup.scanner.laser,
        dead_reckoning=_wrapped(ins[rows]),
        source="ins",
        attitude=se2.wrap(reported[rows]),
        truth=_wrapped(seen[:, :3]),
    )
    walls = setup.world.outlines(setup.scanner.height)
    return SimulatedRun(recording, walls, tilt[rows], driven.ending, setup)


def _wrapped(poses: Array) -> Array:
    return np.column_stack([poses[:, :2], se2.wrap(poses[:, 2])])
