"""What matching costs: time of a match, of the whole front end, and the memory of a long drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scenarios.bench.building import SEGMENTS, building, free_poses
from scenarios.bench.matching.calibration import ROOM
from scenarios.bench.matching.matchers import OURS
from scenarios.bench.matching.pairs import ANGLES, EASY, INTEL, LASER, Pair, near
from scenarios.bench.matching.scores import Matcher, within_limits
from scenarios.bench.result import Figure, time_calls
from scenarios.stages import Stages, timed
from sim.laser import Raycaster
from slam import se2
from slam.formats import load
from slam.matching import LocalMap, Match, Reference
from slam.odometry.tracker import track
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array

PLACES, MAP_SCANS, MATCHES = 30, 20, 10
"""Local maps, scans in each of them, and scans matched against each."""
LAP, RADIUS = 50, 1.0
"""Scans and radius [m] of one round of the long drive, in a room of 6 × 4 m."""
SHORT, LONG = 2_000, 10_000
"""Scans of the drives whose memory is compared."""
RUNS = 3
"""Repetitions of the front end."""


def match_times(
    matchers: Mapping[str, Matcher], pairs: Sequence[Pair], guesses: Array
) -> dict[str, dict[str, float]]:
    """Median processor time [ms] of each matcher's matches by what is counted: from two "scans", as the
    scores have it; "ready" prepared before (index, covariances); from "ranges", points included.

    They take turns pair by pair, so that what else the machine does meets all.
    """
    taken: dict[str, list[tuple[float, float, float]]] = {name: [] for name in matchers}
    for pair, guess in zip(pairs, guesses, strict=True):
        for name, matcher in matchers.items():
            taken[name].append(_timed(matcher, replace(pair), guess))  # a copy, whose scans are not read yet
    medians = {name: (1e3 * np.median(rows, axis=0)).tolist() for name, rows in taken.items()}
    return {name: dict(zip(("scans", "ready", "ranges"), ms, strict=True)) for name, ms in medians.items()}


def _timed(matcher: Matcher, pair: Pair, guess: Array) -> tuple[float, float, float]:
    """Seconds of one match from scans, from what is prepared, and from ranges."""
    scans, reading = timed(lambda: [matcher.read(pair, which) for which in (0, 1)])
    prepared, preparing = timed(lambda: [matcher.prepare(scan) for scan in scans])
    first, again = (timed(matcher.match, *prepared, guess)[1] for _ in range(2))
    return preparing + first, again, reading + preparing + first


def local_map(rng: np.random.Generator) -> list[Figure]:
    """Time [ms] to match a scan against a local map of 20 scans, and to add a scan to it."""
    walls = building(SEGMENTS, rng)
    caster = Raycaster.from_segments(walls)
    matching, adding, errors = [], [], []
    for place in free_poses(walls, PLACES, rng):
        seen = LocalMap(most_scans=MAP_SCANS)
        for T in _around(caster, place, MAP_SCANS, rng):
            scan = _scan(caster, se2.compose(place, T), rng)
            adding.append(1e3 * timed(seen.add, scan, T)[1])
        for T in _around(caster, place, MATCHES, rng):
            query = Reference(_scan(caster, se2.compose(place, T), rng))
            guess = T + rng.uniform(-1.0, 1.0, 3) * [EASY[0], EASY[0], EASY[1]]
            match, seconds = timed(OURS.match, seen, query, guess)
            matching.append(1e3 * seconds)
            if isinstance(match, Match):
                errors.append(se2.between(match.T_reference_scan, T))
    right = 100.0 * np.sum(within_limits(np.reshape(errors, (-1, 3)))) / len(matching)
    # the first of each compiled
    return [
        Figure("match against 20 scans", "ms", tuple(matching[1:]), f"easy guesses; {right:.1f} % successes"),
        Figure("add a scan to the map", "ms", tuple(adding[MAP_SCANS + 1 :])),
    ]


def front_end(data: Path) -> list[Figure]:
    """Scans per second of the front end on the Intel log, reading the scans included; nothing without it."""
    if not (data / INTEL).is_file():
        return []
    recording = load(data / INTEL)
    taken = time_calls({"track": lambda: track(recording)}, RUNS)["track"]
    rates = tuple(len(recording) / seconds for seconds in taken)
    return [Figure("front end, Intel", "scans/s", rates, "from ranges to poses")]


def memory(stages: Stages, rng: np.random.Generator) -> list[Figure]:
    """Memory [kB] of each further scan of a long drive; nothing where the system does not tell."""
    short, long = (round_and_round(count, rng) for count in (SHORT, LONG))
    for recording in (short, long):
        with stages.stage(f"{len(recording)} scans"):
            track(recording)
    few, many = (stages.costs[f"{count} scans"].peak_mb for count in (SHORT, LONG))
    if few is None or many is None:
        return []
    growth = 1024.0 * (many - few) / (LONG - SHORT)
    note = f"peak of the front end, {SHORT} to {LONG} scans"
    return [Figure("memory per further scan", "kB", (growth,), note)]


def round_and_round(count: int, rng: np.random.Generator) -> Recording:
    """A drive of ``count`` scans in circles; its ranges, and the noise in them, return after 40 rounds."""
    turn = 2.0 * np.pi / LAP * np.arange(count)
    poses = np.column_stack([3.0 + RADIUS * np.sin(turn), 2.0 - RADIUS * np.cos(turn), se2.wrap(turn)])
    seen = Raycaster.from_segments(ROOM).cast(poses[: 40 * LAP], ANGLES)
    seen += rng.normal(0.0, LASER.sigma_range, seen.shape)
    ranges = np.resize(seen, (count, len(ANGLES)))
    return Recording("round and round", 0.1 * np.arange(count), ranges, ANGLES, LASER, poses)


def _around(caster: Raycaster, place: Array, count: int, rng: np.random.Generator) -> Array:
    """Poses ``(count, 3)`` in the frame of a place and in its sight."""
    return se2.between(place, np.array([near(caster, place, rng) for _ in range(count)]))


def _scan(caster: Raycaster, pose: Array, rng: np.random.Generator) -> Scan:
    ranges = caster.cast(pose[None], ANGLES)[0]
    return Scan.from_ranges(ranges + rng.normal(0.0, LASER.sigma_range, ranges.shape), ANGLES, LASER)
