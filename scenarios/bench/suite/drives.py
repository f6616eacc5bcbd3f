"""What slamstitch costs on a drive, and on one ten times as long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenarios.bench.result import BenchmarkOptions, BenchmarkResult, Figure
from scenarios.catalogue import CATALOGUE
from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.methods.warm_up import warm_up_recording
from scenarios.stages import Stages, timed
from slam.odometry.dead_reckoning import DeadReckoningConfig
from slam.recording import Recording
from slam.se2 import path_length

SCENARIO = "hospital"
TIMES = 10
YAW_WALK = 0.006
"""Standard deviation [rad] of the yaw that dead reckoning loses per scan, beside what it lost already."""


def run(stages: Stages, options: BenchmarkOptions) -> BenchmarkResult:
    """Processor time and memory of slamstitch on a drive, and on one that repeats it ten times."""
    from sim.record import simulate

    with stages.stage("simulate"):
        once = simulate(CATALOGUE[SCENARIO], options.seed).recording
    METHODS["slamstitch"](warm_up_recording(once), MethodConfig())  # compiles
    far = replay_back_and_forth(once, TIMES, np.random.default_rng(options.seed))
    short, long = (_cost(stages, f"{n} x {SCENARIO}", drive) for n, drive in ((1, once), (TIMES, far)))
    ratio = long[0].per(short[0], f"{TIMES} x as far takes")
    note = f"{SCENARIO}, seed {options.seed}: {once.distance:.0f} m, {len(once)} scans"
    return BenchmarkResult(figures=[*short, *long, ratio], notes=[note])


def _cost(stages: Stages, name: str, drive: Recording) -> list[Figure]:
    """Processor time [s] and, where the system tells, peak memory [MB]."""
    with stages.stage(name):
        _, seconds = timed(METHODS["slamstitch"], drive, MethodConfig())
    peak = stages.costs[name].peak_mb
    figures = [Figure(f"{name}: time", "s", (seconds,))]
    return figures if peak is None else [*figures, Figure(f"{name}: memory", "MB", (peak,))]


def replay_back_and_forth(recording: Recording, times: int, rng: np.random.Generator) -> Recording:
    """The recording driven ``times`` over, backwards every second time, with new noise and a new drift.

    Raises ``ValueError`` for fewer than one time.
    """
    if times < 1:
        raise ValueError(f"a drive there and back: expected 1 time or more, got {times}")
    forwards = np.arange(len(recording))
    rows = np.concatenate([forwards[:: 1 if lap % 2 == 0 else -1] for lap in range(times)])
    new = np.arange(len(rows)) >= len(recording)
    walked = np.diff(path_length(recording.dead_reckoning[rows]), prepend=0.0)
    sigma = np.stack(
        [np.sqrt(DeadReckoningConfig().ins_walk * walked)] * 2 + [np.full(len(rows), YAW_WALK)], -1
    )
    drift = np.cumsum(np.where(new[:, None], rng.normal(0.0, 1.0, (len(rows), 3)) * sigma, 0.0), axis=0)
    noise = rng.normal(0.0, recording.laser.sigma_range, (len(rows), len(recording.angles)))
    return replace(
        recording,
        name=f"{recording.name} x {times}",
        time=float(np.median(np.diff(recording.time))) * np.arange(len(rows)),
        ranges=recording.ranges[rows] + np.where(new[:, None], noise, 0.0),
        dead_reckoning=recording.dead_reckoning[rows] + drift,
        odometry=None,
        attitude=None if recording.attitude is None else recording.attitude[rows],
        truth=None if recording.truth is None else recording.truth[rows],
        relations=None,
    )
