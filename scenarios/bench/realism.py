"""python -m scenarios.bench.realism: is a simulated drive like a real one? The same figures of both.

Truth and INS are first rounded to the two decimals that USARSim prints, in the real log and in the simulated
ones, so that quantisation is no difference between them. Scans of a robot that lies on its side or its back
say nothing of how rough the ground is, and are left out of the tilt.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from scenarios.catalogue import CATALOGUE
from slam import se2
from slam.cli import InputError, main, nearest
from slam.recording import Recording
from slam.se2 import Array
from slam.table import ABSENT, Columns, Table

COMMAND = "scenarios.bench.realism"

FALLEN = np.deg2rad(60.0)
"""A robot with more roll or pitch [rad] lies on its side."""
WINDOW = 31
"""Scans in the running median that the tilt is measured from: what is left is shaking, not an offset."""
TURN_STEP, DRIVE_STEP = 0.05, 0.05
"""Turning and driving count from this much on [rad, m], so that quantisation does not count as motion."""
TURN_WINDOW = 2.0 * np.pi
"""INS yaw errors are compared over this much turning [rad]."""
DECIMALS = 2
"""Of a pose or angle as USARSim prints it."""
QUARTILES = (25, 50, 75)
SLACK = 1e-6
"""Printed angles come in steps: equal ones may differ by the rounding of a percentile."""

Figures = dict[tuple[str, str], float]
"""Figures of a recording by name and unit; NaN where it is too short for one."""


@dataclass(frozen=True)
class Options:
    """Print the figures of a real log beside the quartiles of simulated drives."""

    log: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """A recording with truth, such as the log of the thesis's Experiment 1."""
    seeds: Annotated[int, arg(metavar="N")] = 10
    """Simulated are seeds 0 to N - 1."""
    scenario: Annotated[str, arg(metavar="NAME")] = "hospital"
    """Which scenario is simulated."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class Comparison:
    """One figure of the real drive, None without one, beside quartiles and extremes of the simulated ones."""

    name: str
    unit: str
    real: float | None
    low: float
    median: float
    high: float
    least: float
    most: float

    @property
    def bracketed(self) -> Literal["quartiles", "range", "no"] | None:
        """Whether the simulated quartiles, or at least the simulated range, lie around the real figure."""
        if self.real is None:
            return None
        if self.low - SLACK <= self.real <= self.high + SLACK:
            return "quartiles"
        return "range" if self.least - SLACK <= self.real <= self.most + SLACK else "no"


COLUMNS: Columns = (
    ("figure", lambda one: one.name),
    ("unit", lambda one: one.unit),
    ("real", lambda one: ABSENT if one.real is None else f"{one.real:.3g}"),
    ("simulated 25 %", lambda one: f"{one.low:.3g}"),
    ("50 %", lambda one: f"{one.median:.3g}"),
    ("75 %", lambda one: f"{one.high:.3g}"),
    ("least", lambda one: f"{one.least:.3g}"),
    ("most", lambda one: f"{one.most:.3g}"),
    ("brackets the real one", lambda one: one.bracketed or ABSENT),
)


def run(options: Options) -> None:
    """Measure, compare, and print."""
    comparisons = against_simulated(options.log, options.seeds, options.scenario)
    if options.format == "json":
        print(json.dumps([{**asdict(c), "bracketed": c.bracketed} for c in comparisons], indent=1))
        return
    name = "nothing real" if options.log is None else options.log.name
    title = f"{name} beside {options.scenario}, seeds 0 to {options.seeds - 1}"
    Table.of(comparisons, COLUMNS, title).print()


def against_simulated(log: Path | None, seeds: int, scenario: str) -> list[Comparison]:
    """Figures of a real log, where there is one, beside seeds 0, 1, … of a scenario.

    Raises `InputError` for a log that cannot be read or has no truth, no seeds, or an unknown scenario.
    """
    if seeds < 1:
        raise InputError(f"--seeds: expected 1 or more, got {seeds}")
    if scenario not in CATALOGUE:
        raise InputError(f"unknown scenario {scenario!r}: {nearest(scenario, CATALOGUE)}")

    from sim.record import simulate
    from slam.formats import FormatError, load

    try:
        real = None if log is None else load(log)
    except FormatError as error:
        raise InputError(str(error)) from error
    if real is not None and real.truth is None:
        raise InputError(f"{log}: no truth, expected a recording with the robot's true poses")
    return compare(real, [simulate(CATALOGUE[scenario], seed).recording for seed in range(seeds)])


def compare(real: Recording | None, simulated: Sequence[Recording]) -> list[Comparison]:
    """All figures of a real recording, or none, beside simulated ones, but those that all of these are too
    short for. All need truth."""
    drives = [measure(recording) for recording in simulated]
    of_real = {} if real is None else measure(real)
    comparisons = []
    for name in drives[0]:
        values = np.array([drive[name] for drive in drives])
        values = values[np.isfinite(values)]
        if len(values):
            value = of_real.get(name, np.nan)
            quantiles = np.percentile(values, [*QUARTILES, 0, 100]).tolist()
            comparisons.append(Comparison(*name, None if np.isnan(value) else value, *quantiles))
    return comparisons


def measure(recording: Recording) -> Figures:
    """Figures of one recording. Raises ``ValueError`` for one without truth."""
    if recording.truth is None:
        raise ValueError(f"{recording.name}: expected a recording with truth")
    ins, truth = np.round(recording.dead_reckoning, DECIMALS), np.round(recording.truth, DECIMALS)
    step = np.diff(truth, axis=0)
    return {
        **_matching_figures(recording),
        **({} if recording.attitude is None else _tilt_figures(np.round(recording.attitude, DECIMALS))),
        **_drift_figures(ins, truth),
        **_quartiles("step per scan", "m", np.hypot(step[:, 0], step[:, 1])),
        **_quartiles("turn per scan", "°", np.degrees(np.abs(se2.wrap(step[:, 2])))),
    }


def _matching_figures(recording: Recording) -> Figures:
    """What ManifoldSLAM's matcher makes of the scans, and how many beams come back."""
    from slam.odometry.track import Verdict
    from slam.odometry.tracker import MANIFOLD_SLAM, track

    tracked = track(recording, MANIFOLD_SLAM)
    matches = tracked.matches[1:][tracked.verdict[1:] != Verdict.SKIPPED]
    return {
        ("steps without a match", "%"): 100.0 * float(np.mean(matches == 0)),
        **_quartiles("matches per step", "", matches),
        **_quartiles("valid beams per scan", "", np.isfinite(recording.ranges).sum(axis=1)),
    }


def _tilt_figures(attitude: Array) -> Figures:
    """Quantiles of roll and pitch off their running median, while the robot is upright."""
    from scipy.ndimage import median_filter

    attitude = attitude[np.abs(attitude).max(axis=1) < FALLEN]
    shaking = np.degrees(np.abs(attitude - median_filter(attitude, (WINDOW, 1), mode="nearest")))
    return {
        (f"|{name}| {q} % quantile", "°"): float(np.percentile(shaking[:, k], q))
        for k, name in enumerate(("roll", "pitch"))
        for q in (50, 75, 90, 99)
    }


def _drift_figures(ins: Array, truth: Array) -> Figures:
    """How the INS's errors grow with turning and driving."""
    yaw_error = np.unwrap(ins[:, 2] - truth[:, 2])
    yaw_error = np.degrees(yaw_error - yaw_error[0])
    position_error = ins[:, :2] - truth[:, :2]
    position_error = np.hypot(*(position_error - position_error[0]).T)
    turned = _path_length(np.unwrap(truth[:, 2])[:, None], TURN_STEP)
    driven = _path_length(truth[:, :2], DRIVE_STEP)
    at_turns = yaw_error[np.searchsorted(turned, np.arange(0.0, turned[-1], TURN_WINDOW))]
    gained = np.abs(np.diff(at_turns)) if len(at_turns) > 1 else np.array([np.nan])
    far = int(np.searchsorted(driven, 100.0))
    there = far < len(truth)
    return {
        ("INS yaw error gained per radian turned, median", "°"): float(np.median(gained)) / TURN_WINDOW,
        ("INS yaw error gained per radian turned, mean", "°"): float(np.mean(gained)) / TURN_WINDOW,
        ("INS yaw error after 100 m", "°"): float(abs(yaw_error[far])) if there else np.nan,
        ("INS position error after 100 m", "m"): float(position_error[far]) if there else np.nan,
        ("turned per metre driven", "°"): float(np.degrees(turned[-1]) / max(driven[-1], DRIVE_STEP)),
    }


def _path_length(values: Array, least: float) -> Array:
    """Length ``(N,)`` of the path through ``values (N, d)``, in strides of at least ``least``."""
    length, anchor = np.zeros(len(values)), values[0]
    for k in range(1, len(values)):
        stride = float(np.linalg.norm(values[k] - anchor))
        length[k] = length[k - 1]
        if stride >= least:
            length[k] += stride
            anchor = values[k]
    return length


def _quartiles(name: str, unit: str, values: Array) -> Figures:
    quartiles = np.percentile(values, QUARTILES) if len(values) else np.full(3, np.nan)
    return {(f"{name}, {q} %", unit): float(v) for q, v in zip(QUARTILES, quartiles, strict=True)}


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
