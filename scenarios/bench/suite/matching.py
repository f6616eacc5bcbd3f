"""The scan matcher beside its baselines, its parts and other people's: success, honesty, accuracy, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from scenarios.bench.matching import calibration, cost
from scenarios.bench.matching.bound import efficiency
from scenarios.bench.matching.matchers import ABLATION, VARIANTS
from scenarios.bench.matching.pairs import EASY, HARD, Pair, PairSet, experiment_1, guesses, intel, simulated
from scenarios.bench.matching.scores import (
    Matcher,
    match_all,
    matches_and_errors,
    measure,
    within_limits,
)
from scenarios.bench.matching.tables import (
    TIMED_FROM,
    Record,
    calibration_table,
    efficiency_table,
    score_tables,
    speed_table,
)
from scenarios.bench.matching.third_party_matchers import GICP, third_party_matchers
from scenarios.bench.result import BenchmarkOptions, BenchmarkResult
from scenarios.stages import Stages
from slam.cli import InputError
from slam.formats import FormatError
from slam.se2 import Array

GUESSES = {"easy": EASY, "hard": HARD}
ROOM_PAIRS = 7
"""Pairs in the room for each pair of a set: a ratio of variances is known to 8 % only by 300."""


def run(stages: Stages, options: BenchmarkOptions) -> BenchmarkResult:
    """All figures of the matcher, compilation excluded."""
    drawn = np.random.default_rng(options.seed).spawn(7)
    with stages.stage("pairs"):
        sets, notes = pair_sets(options, drawn[0])
    others, missing = third_party_matchers()
    ablation = {variant.name: variant.matcher for variant in ABLATION}
    matchers = {variant.name: variant.matcher for variant in VARIANTS} | others
    warm_up([*matchers.values(), *ablation.values()], sets[0].pairs[0])
    with stages.stage("scores"):
        scores = score_records(sets, {**matchers, **ablation}, drawn[1])
    with stages.stage("calibration"):
        calibrated = calibration_records(drawn[2])
        efficient = efficiency_records(matchers, sets[0], drawn[3])
    with stages.stage("speed"):
        fast = speed_records(sets, matchers, drawn[4])
    with stages.stage("front end"):
        figures = [*cost.local_map(drawn[5]), *cost.front_end(options.data)]
    figures += cost.memory(stages, drawn[6])
    tables = [
        *score_tables(scores, frozenset((len(VARIANTS) - 1, len(matchers) - 1))),
        calibration_table(calibrated),
        efficiency_table(efficient),
        speed_table(fast),
    ]
    records = {"scores": scores, "calibration": calibrated, "efficiency": efficient, "speed": fast}
    reasons = [f"{package}: {reason}" for package, reason in missing.items()]
    return BenchmarkResult(figures, tables, records, [*notes, *reasons])


def pair_sets(options: BenchmarkOptions, rng: np.random.Generator) -> tuple[list[PairSet], list[str]]:
    """The kinds of pairs there are, the simulated first, and a note on each, or on why it is missing.

    Raises `InputError` for a log that cannot be read.
    """
    try:
        kinds = [
            simulated(options.pairs, rng),
            intel(options.data, options.pairs),
            experiment_1(options.data, options.pairs),
            experiment_1(options.data, options.pairs, moving=True),
        ]
    except FormatError as bad:
        raise InputError(str(bad)) from bad
    sets = [kind for kind in kinds if isinstance(kind, PairSet)]
    notes = [k if isinstance(k, str) else f"{k.name}: {len(k)} pairs, {k.note}" for k in kinds]
    return sets, notes


def warm_up(matchers: Sequence[Matcher], pair: Pair) -> None:
    """Let everything compile and load that does so at the first call."""
    for matcher in matchers:
        measure(matcher, [pair], pair.T_reference_scan[None])


def score_records(
    sets: Sequence[PairSet], matchers: Mapping[str, Matcher], rng: np.random.Generator
) -> list[Record]:
    """Scores of all matchers on the same guesses, easy and hard, of every kind of pair."""
    started = {
        (level, kind.name): guesses(kind.pairs, off, rng) for level, off in GUESSES.items() for kind in sets
    }
    return [
        {"matcher": name, "guesses": level, "data": kind.name}
        | asdict(measure(matcher, kind.pairs, started[level, kind.name]))
        for name, matcher in matchers.items()
        for level in GUESSES
        for kind in sets
    ]


def calibration_records(rng: np.random.Generator) -> list[Record]:
    """Errors beside what the covariances claim, in the room and in the corridor."""
    records: list[Record] = []
    for place in calibration.PLACES:
        pairs = calibration.pairs_at(place, calibration.PAIRS, rng)
        seeds = calibration.seeded(pairs, rng)
        for variant in calibration.MODES:
            t = calibration.trials(variant, pairs, seeds)
            records.append(
                {"place": place, "matcher": variant.name, "answers": len(t.errors), "anees": t.anees}
                | {"rms": t.rms.tolist(), "claimed": t.claimed.tolist()}
            )
    return records


def efficiency_records(
    matchers: Mapping[str, Matcher], built: PairSet, rng: np.random.Generator
) -> list[Record]:
    """How near the successes are to the bound, in the room and in the simulated building."""
    assert built.walls is not None
    room = calibration.pairs_at("room", ROOM_PAIRS * len(built), rng)
    cases = (
        ("room", room, calibration.PLACES["room"][0], calibration.seeded(room, rng)),
        ("building, easy guesses", built.pairs, built.walls, guesses(built.pairs, EASY, rng)),
    )
    return [
        {"data": data, "matcher": name} | _efficiency(matcher, pairs, walls, seeds)
        for data, pairs, walls, seeds in cases
        for name, matcher in matchers.items()
    ]


def _efficiency(matcher: Matcher, pairs: Sequence[Pair], walls: Array, seeds: Array) -> dict[str, object]:
    matched, errors = matches_and_errors(pairs, match_all(matcher, pairs, seeds)[0])
    good = np.flatnonzero(within_limits(errors))
    if len(good) == 0:
        return {"translation": None, "rotation": None}
    return asdict(efficiency([matched[i][0] for i in good], walls, errors[good]))


def speed_records(
    sets: Sequence[PairSet], matchers: Mapping[str, Matcher], rng: np.random.Generator
) -> list[Record]:
    """Times of all matchers in turns, by what is counted in, and how many times as long small_gicp takes."""
    records: list[Record] = []
    for kind in sets:
        times = cost.match_times(matchers, kind.pairs, guesses(kind.pairs, EASY, rng))
        for name, ms in times.items():
            ratio = {f"{way}_ratio": _ratio(times, name, way) for way in TIMED_FROM}
            records.append({"data": kind.name, "matcher": name} | asdict(ms) | ratio)
    return records


def _ratio(times: Mapping[str, cost.MatchTimes], name: str, way: str) -> float | None:
    return getattr(times[GICP], way) / getattr(times[name], way) if GICP in times else None
