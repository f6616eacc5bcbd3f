"""The simulator: rays per second beside pymunk's own query, growth with the building, and a whole drive."""

from __future__ import annotations

from functools import partial

import numpy as np
import pymunk

from scenarios.bench.building import SEGMENTS, building, free_poses
from scenarios.bench.result import BenchmarkOptions, BenchmarkResult, Call, Figure, time_calls
from scenarios.catalogue import CATALOGUE
from scenarios.stages import Stages
from sim.driver import resample
from sim.laser import Raycaster
from sim.record import SimulatedRun, simulate
from slam import se2
from slam.se2 import Array

ANGLES = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
TILT = np.deg2rad(5.0)
WALL_HEIGHT = 2.5
SENSOR_HEIGHT = 0.3
LARGER = (2_000, 20_000)
POSES, POSES_OF_LOOP = 1_000, 40
REPETITIONS, DRIVES = 15, 3
SCENARIO = "hospital"


Case = tuple[str, Call, int, str]
"""Its name, what casts all beams of a number of poses, that number, and a note."""


def run(stages: Stages, options: BenchmarkOptions) -> BenchmarkResult:
    """All figures of the simulator, compilation excluded."""
    with stages.stage("rays"):
        figures = rays()
    with stages.stage("growth"):
        figures += growth()
    return BenchmarkResult(figures + drives(stages))


def rays() -> list[Figure]:
    """Rays per second in the building of 200 segments, and how many times the loop over pymunk's query."""
    rng = np.random.default_rng(0)
    walls = building(SEGMENTS, rng)
    poses = free_poses(walls, POSES, rng)
    thin = Raycaster.from_segments(walls)
    high = Raycaster.from_segments(walls, np.full(SEGMENTS, WALL_HEIGHT))
    turn = np.array([0.0, 0.0, np.deg2rad(30.0)])
    turned = Raycaster.from_segments(se2.transform(turn, walls.reshape(-1, 2)).reshape(-1, 4))
    setup = CATALOGUE[SCENARIO].build(rng)
    solid, route = Raycaster(setup.world), along(setup.waypoints)
    few, space, reach = poses[:POSES_OF_LOOP], space_of(walls), float(np.hypot(*np.ptp(walls[:, :2], axis=0)))
    beams = f"{SEGMENTS} segments, 40 × 30 m, {len(ANGLES)} beams over 180°"
    by_pymunk = partial(pymunk_loop, space, few, reach)
    at_angle = partial(turned.cast, se2.compose(turn, poses), ANGLES)
    in_scenario = partial(solid.cast_with_incidence, tilted(route), ANGLES)
    uneven = "solids, uneven ground and ceiling, with incidence"
    cases: list[Case] = [
        ("pymunk", by_pymunk, len(few), "segment_query_first in a Python loop"),
        ("flat", partial(thin.cast, poses, ANGLES), POSES, beams),
        ("tilted", partial(high.cast, tilted(poses), ANGLES), POSES, "roll and pitch up to 5°"),
        ("flat, turned", at_angle, POSES, "building at 30°"),
        (f"tilted, {SCENARIO}", in_scenario, len(route), uneven),
    ]
    loop, flat, tilt, *others = rates(cases)
    return [loop, flat, tilt, *others, flat.per(loop, "flat / pymunk"), tilt.per(loop, "tilted / pymunk")]


def growth() -> list[Figure]:
    """Flat rays per second, and the time to prepare, in larger and larger buildings of the same density."""
    cases: list[Case] = []
    preparations: dict[str, Call] = {}
    for count in (SEGMENTS, *LARGER):
        rng = np.random.default_rng(0)
        walls = building(count, rng)
        cast = partial(Raycaster.from_segments(walls).cast, free_poses(walls, POSES, rng), ANGLES)
        cases.append((f"flat, {count} segments", cast, POSES, "a larger building of the same density"))
        preparations[f"prepare {count} segments"] = partial(Raycaster.from_segments, walls)
    flat = rates(cases)
    slower = flat[0].per(flat[-1], f"time per ray, {LARGER[-1]} / {SEGMENTS} segments")
    taken = time_calls(preparations, REPETITIONS)
    preparing = [Figure(name, "ms", tuple(1e3 * t for t in times)) for name, times in taken.items()]
    return [*flat, slower, *preparing]


def drives(stages: Stages) -> list[Figure]:
    """A whole scenario, world, physics, laser and INS: simulated seconds per second, and peak memory."""
    runs: list[SimulatedRun] = []
    with stages.stage("drives"):
        taken = time_calls({"": lambda: runs.append(simulate(CATALOGUE[SCENARIO], 0))}, DRIVES)[""]
    lasted, peak = float(np.ptp(runs[0].recording.time)), stages.costs["drives"].peak_mb
    pace, note = tuple(lasted / seconds for seconds in taken), f"seed 0, {lasted:.0f} s simulated"
    figures = [Figure(f"{SCENARIO}, whole simulation", "× real time", pace, note)]
    return figures if peak is None else [*figures, Figure("peak memory", "MB", (peak,), "of the process")]


def rates(cases: list[Case]) -> list[Figure]:
    """Millions of rays per second of every case."""
    taken = time_calls({name: call for name, call, _, _ in cases}, REPETITIONS)
    return [
        Figure(name, "M rays/s", tuple(1e-6 * poses * len(ANGLES) / t for t in taken[name]), note)
        for name, _, poses, note in cases
    ]


def tilted(poses: Array) -> Array:
    """Poses ``(N, 6)`` of a tilted sensor at poses ``(N, 3)``, the same whenever they are asked for."""
    tilt = np.random.default_rng(1).uniform(-TILT, TILT, (len(poses), 2))
    return np.column_stack([poses, tilt, np.full(len(poses), SENSOR_HEIGHT)])


def along(waypoints: Array) -> Array:
    """Poses ``(N, 3)`` every 0.2 m of a route, looking along it."""
    points = resample(waypoints, 0.2)
    steps = np.gradient(points, axis=0)
    return np.column_stack([points, np.arctan2(steps[:, 1], steps[:, 0])])


def space_of(walls: Array) -> pymunk.Space:
    """The walls as pymunk's thin segments."""
    space = pymunk.Space()
    for x1, y1, x2, y2 in walls.tolist():
        space.add(pymunk.Segment(space.static_body, (x1, y1), (x2, y2), 0.0))
    return space


def pymunk_loop(space: pymunk.Space, poses: Array, reach: float) -> None:
    """The nearest hit of every beam of every pose, as pymunk's users ask for it."""
    everything = pymunk.ShapeFilter()
    for x, y, yaw in poses.tolist():
        ends = np.array([x, y]) + reach * np.column_stack([np.cos(yaw + ANGLES), np.sin(yaw + ANGLES)])
        for end in ends.tolist():
            space.segment_query_first((x, y), end, 0.0, everything)
