"""The scan matcher beside its baselines, its parts and other people's: success, honesty, accuracy, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from scenarios.bench.matching import calibration, cost
from scenarios.bench.matching.bound import efficiency
from scenarios.bench.matching.matchers import ABLATION, VARIANTS
from scenarios.bench.matching.pairs import EASY, HARD, Pair, PairSet, experiment_1, guesses, intel, simulated
from scenarios.bench.matching.peers import GICP, peers
from scenarios.bench.matching.scores import Matcher, ask, error, measure, within_limits
from scenarios.bench.matching.speed import Times, times
from scenarios.bench.matching.tables import (
    WAYS,
    Record,
    calibration_table,
    efficiency_table,
    score_tables,
    speed_table,
)
from scenarios.bench.measured import Asked, Measured
from scenarios.stages import Stages
from slam.cli import InputError
from slam.formats import FormatError
from slam.matching import NoMatch
from slam.se2 import Array

GUESSES = {"easy": EASY, "hard": HARD}
ROOM_PAIRS = 7
"""Pairs in the room for each pair of a set: a ratio of variances is known to 8 % only by 300."""


def run(stages: Stages, asked: Asked) -> Measured:
    """All figures of the matcher, compilation excluded."""
    drawn = np.random.default_rng(asked.seed).spawn(7)
    with stages.stage("pairs"):
        sets, notes = pair_sets(asked, drawn[0])
    others, missing = installed()
    ablation = {variant.name: variant.matcher for variant in ABLATION}
    matchers = {variant.name: variant.matcher for variant in VARIANTS} | others
    warm_up([*matchers.values(), *ablation.values()], sets[0].pairs[0])
    with stages.stage("scores"):
        scores = scored(sets, {**matchers, **ablation}, drawn[1])
    with stages.stage("calibration"):
        calibrated = calibrations(drawn[2])
        efficient = efficiencies(matchers, sets[0], drawn[3])
    with stages.stage("speed"):
        fast = speeds(sets, matchers, drawn[4])
    with stages.stage("front end"):
        figures = [*cost.local_map(drawn[5]), *cost.front_end(asked.data)]
    figures += cost.memory(stages, drawn[6])
    tables = [
        *score_tables(scores, (len(VARIANTS) - 1, len(matchers) - 1)),
        calibration_table(calibrated),
        efficiency_table(efficient),
        speed_table(fast),
    ]
    records = {"scores": scores, "calibration": calibrated, "efficiency": efficient, "speed": fast}
    return Measured(figures, tables, records, [*notes, *missing])


def pair_sets(asked: Asked, rng: np.random.Generator) -> tuple[list[PairSet], list[str]]:
    """The kinds of pairs there are, the simulated first, and a note on each, or on why it is missing.

    Raises `InputError` for a log that cannot be read.
    """
    try:
        found = [
            simulated(asked.pairs, rng),
            intel(asked.data, asked.pairs),
            experiment_1(asked.data, asked.pairs),
            experiment_1(asked.data, asked.pairs, moving=True),
        ]
    except FormatError as bad:
        raise InputError(str(bad)) from bad
    sets = [kind for kind in found if isinstance(kind, PairSet)]
    notes = [k if isinstance(k, str) else f"{k.name}: {len(k)} pairs, {k.note}" for k in found]
    return sets, notes


def installed() -> tuple[dict[str, Matcher], list[str]]:
    """Peers that can be used, and a line for each that cannot."""
    found = peers()
    usable = {name: peer for name, peer in found.items() if isinstance(peer, Matcher)}
    return usable, [f"{name}: {why}" for name, why in found.items() if isinstance(why, str)]


def warm_up(matchers: Sequence[Matcher], pair: Pair) -> None:
    """Let everything compile and load that does so at the first call."""
    for matcher in matchers:
        measure(matcher, [pair], pair.T_reference_scan[None])


def scored(
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


def calibrations(rng: np.random.Generator) -> list[Record]:
    """Errors beside what the covariances claim, in the room and in the corridor."""
    found: list[Record] = []
    for place in calibration.PLACES:
        pairs = calibration.pairs_at(place, calibration.PAIRS, rng)
        seeds = calibration.seeded(pairs, rng)
        for variant in calibration.MODES:
            t = calibration.trials(variant, pairs, seeds)
            found.append(
                {"place": place, "matcher": variant.name, "answers": len(t.errors), "anees": t.anees}
                | {"rms": t.rms.tolist(), "claimed": t.claimed.tolist()}
            )
    return found


def efficiencies(matchers: Mapping[str, Matcher], built: PairSet, rng: np.random.Generator) -> list[Record]:
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
    answers, _ = ask(matcher, pairs, seeds)
    given = [(pair, a) for pair, a in zip(pairs, answers, strict=True) if not isinstance(a, NoMatch)]
    errors = np.array([error(*found) for found in given]).reshape(-1, 3)
    good = np.flatnonzero(within_limits(errors))
    if len(good) == 0:
        return {"translation": None, "rotation": None}
    return asdict(efficiency([given[i][0] for i in good], walls, errors[good]))


def speeds(
    sets: Sequence[PairSet], matchers: Mapping[str, Matcher], rng: np.random.Generator
) -> list[Record]:
    """Times of all matchers in turns, by what is counted in, and how many times as long small_gicp takes."""
    found: list[Record] = []
    for kind in sets:
        taken = times(matchers, kind.pairs, guesses(kind.pairs, EASY, rng))
        for name, ms in taken.items():
            ratio = {f"{way}_ratio": _ratio(taken, name, way) for way in WAYS}
            found.append({"data": kind.name, "matcher": name} | asdict(ms) | ratio)
    return found


def _ratio(taken: Mapping[str, Times], name: str, way: str) -> float | None:
    return getattr(taken[GICP], way) / getattr(taken[name], way) if GICP in taken else None
