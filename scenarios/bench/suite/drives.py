"""What slamstitch costs on a drive, and on one ten times as long."""

from __future__ import annotations

import time

import numpy as np

from scenarios.bench.figure import Figure
from scenarios.bench.lengthened import there_and_back
from scenarios.bench.measured import Asked, Measured
from scenarios.catalogue import CATALOGUE
from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.methods.warm_up import warm_up_recording
from scenarios.stages import Stages
from slam.recording import Recording

SCENARIO = "hospital"
TIMES = 10


def run(stages: Stages, asked: Asked) -> Measured:
    """Processor time and memory of slamstitch on a drive, and there and back ten times as far."""
    from sim.record import simulate

    with stages.stage("simulate"):
        once = simulate(CATALOGUE[SCENARIO], asked.seed).recording
    METHODS["slamstitch"](warm_up_recording(once), MethodConfig())  # compiles
    far = there_and_back(once, TIMES, np.random.default_rng(asked.seed))
    short, long = (_cost(stages, f"{n} x {SCENARIO}", drive) for n, drive in ((1, once), (TIMES, far)))
    ratio = long[0].per(short[0], f"{TIMES} x as far takes")
    note = f"{SCENARIO}, seed {asked.seed}: {once.distance:.0f} m, {len(once)} scans"
    return Measured(figures=[*short, *long, ratio], notes=[note])


def _cost(stages: Stages, name: str, drive: Recording) -> list[Figure]:
    """Processor time [s] and, where the system tells, peak memory [MB]."""
    with stages.stage(name):
        started = time.process_time()
        METHODS["slamstitch"](drive, MethodConfig())
        taken = time.process_time() - started
    peak = stages.costs[name].peak_mb
    figures = [Figure(f"{name}: time", "s", (taken,))]
    return figures if peak is None else [*figures, Figure(f"{name}: memory", "MB", (peak,))]
