"""The scan matcher beside its baselines, its parts and other people's: success, honesty, accuracy, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from scenarios.bench.matching import calibration, cost
from scenarios.bench.matching.matchers import ABLATION, GICP, VARIANTS, third_party_matchers
from scenarios.bench.matching.pairs import EASY, HARD, Pair, PairSet, experiment_1, guesses, intel, simulated
from scenarios.bench.matching.scores import Matcher, match_all, matches_and_errors, measure, within_limits
from scenarios.bench.result import DATA_FOLDER, BenchmarkOptions, BenchmarkResult
from scenarios.stages import Stages
from slam.cli import InputError
from slam.formats import FormatError
from slam.table import ABSENT, Columns, Table

Record = Mapping[str, Any]

GUESSES = {"easy": EASY, "hard": HARD}
ROOM_PAIRS = 7
"""Pairs in the room for each pair of a set: a ratio of variances is known to 8 % only by 300."""
MILLI, DEGREES = 1e3, 180.0 / np.pi


def number(value: float | None, digits: int = 2, scale: float = 1.0) -> str:
    """``scale`` times a number with so many decimals, or with one digit where it is huge."""
    if value is None:
        return ABSENT
    return f"{scale * value:.{digits}f}" if abs(scale * value) < 1e4 else f"{scale * value:.0e}"


def _percent(share: float | None) -> str:
    return number(share, 1, 100.0)


def _millimetres(values: Sequence[float]) -> str:
    return f"{number(values[0], 1, MILLI)} / {number(values[1], 1, MILLI)}"


TOPICS: Columns = (
    (
        "Success: within 0.10 m and 2°, % [95 % interval]",
        lambda r: f"{_percent(r['success'])} [{_percent(r['success_low'])}–{_percent(r['success_high'])}]",
    ),
    (
        "Silent failures / no match, %: beyond the limits and not covered by the claimed 3σ / no answer",
        lambda r: f"{_percent(r['silent'])} / {_percent(r['no_match'])}",
    ),
    (
        "ANEES/3: mean over all answers (from the median); 1 is honest; Intel's truth is a peer's answer",
        lambda r: f"{number(r['anees'])} ({number(r['anees_median'])})",
    ),
    (
        "Error of the successes, rms: mm / °",
        lambda r: f"{number(r['rms_m'], 1, MILLI)} / {number(r['rms_rad'], 2, DEGREES)}",
    ),
    (
        "Processor time of a match, from scans to pose and covariance, ms: median (95 %)",
        lambda r: f"{number(r['ms'])} ({number(r['ms_95'])})",
    ),
)
"""What is shown of the scores, one table each."""
CALIBRATION: Columns = (
    ("place", lambda r: r["place"]),
    ("method, covariance", lambda r: r["matcher"]),
    ("rms x / y mm", lambda r: _millimetres(r["rms"])),
    ("yaw °", lambda r: number(r["rms"][2], 3, DEGREES)),
    ("claimed x / y mm", lambda r: _millimetres(r["claimed"])),
    ("claimed yaw °", lambda r: number(r["claimed"][2], 3, DEGREES)),
    ("ANEES/3", lambda r: number(r["anees"])),
    ("answers", lambda r: str(r["answers"])),
)
EFFICIENCY: Columns = (
    ("pairs", lambda r: r["data"]),
    ("matcher", lambda r: r["matcher"]),
    ("translation", lambda r: number(r["translation"])),
    ("rotation", lambda r: number(r["rotation"])),
)
SPEED: Columns = (
    ("pairs", lambda r: r["data"]),
    ("matcher", lambda r: r["matcher"]),
    ("scans given", lambda r: f"{number(r['scans'], 3)} ({number(r['scans_ratio'], 1)})"),
    ("index and covariances ready", lambda r: f"{number(r['ready'], 3)} ({number(r['ready_ratio'], 1)})"),
    ("from ranges", lambda r: f"{number(r['ranges'], 3)} ({number(r['ranges_ratio'], 1)})"),
)
TITLES = {
    "calibration": "Calibration: pairs from one place, errors along the world's axes",
    "efficiency": "Efficiency of the successes: Cramér–Rao bound / mean squared error",
    "speed": "Processor time of a match, easy guesses, ms: median (small_gicp GICP / this)",
}


def run(stages: Stages, options: BenchmarkOptions) -> BenchmarkResult:
    """All figures of the matcher, compilation excluded."""
    drawn = np.random.default_rng(options.seed).spawn(7)
    with stages.stage("pairs"):
        sets, notes = pair_sets(options, drawn[0])
    others, missing = third_party_matchers()
    ablation = {variant.name: variant.matcher for variant in ABLATION}
    matchers = {variant.name: variant.matcher for variant in VARIANTS} | others
    for matcher in [*matchers.values(), *ablation.values()]:  # compiles and loads
        measure(matcher, sets[0].pairs[:1], sets[0].pairs[0].T_reference_scan[None])
    with stages.stage("scores"):
        records = {"scores": score_records(sets, {**matchers, **ablation}, drawn[1])}
    with stages.stage("calibration"):
        records["calibration"] = calibration_records(drawn[2])
        records["efficiency"] = efficiency_records(matchers, sets[0], drawn[3])
    with stages.stage("speed"):
        records["speed"] = speed_records(sets, matchers, drawn[4])
    with stages.stage("front end"):
        figures = [*cost.local_map(drawn[5]), *cost.front_end(options.data or DATA_FOLDER)]
    figures += cost.memory(stages, drawn[6])
    tables = score_tables(records["scores"], frozenset((len(VARIANTS) - 1, len(matchers) - 1)))
    for (topic, title), columns in zip(TITLES.items(), (CALIBRATION, EFFICIENCY, SPEED), strict=True):
        tables.append(Table.of(records[topic], columns, title, names=2))
    reasons = [f"{package}: {reason}" for package, reason in missing.items()]
    return BenchmarkResult(figures, tables, records, [*notes, *reasons])


def score_tables(records: Sequence[Record], sections: frozenset[int]) -> list[Table]:
    """A table for each of the `TOPICS` and level of guesses, by matcher and kind of pair."""
    matchers, kinds = (list(dict.fromkeys(r[name] for r in records)) for name in ("matcher", "data"))
    by_place = {(r["matcher"], r["guesses"], r["data"]): r for r in records}
    return [
        Table(
            ("matcher", *kinds),
            [(m, *(cell(by_place[m, level, kind]) for kind in kinds)) for m in matchers],
            f"{level} guesses · {title}",
            sections=sections,
        )
        for title, cell in TOPICS
        for level in GUESSES
    ]


def pair_sets(options: BenchmarkOptions, rng: np.random.Generator) -> tuple[list[PairSet], list[str]]:
    """The kinds of pairs there are, the simulated first, and a note on each, or on why it is missing.

    Raises `InputError` for a log that cannot be read.
    """
    count, data = options.pairs, options.data or DATA_FOLDER
    try:
        logged = [intel(data, count), *(experiment_1(data, count, moving) for moving in (False, True))]
    except FormatError as bad:
        raise InputError(str(bad)) from bad
    kinds = [simulated(count, rng), *logged]
    sets = [kind for kind in kinds if isinstance(kind, PairSet)]
    return sets, [k if isinstance(k, str) else f"{k.name}: {len(k)} pairs, {k.note}" for k in kinds]


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
    cases: list[tuple[str, Sequence[Pair], Any, Any]] = [
        ("room", room, calibration.PLACES["room"][0], calibration.seeded(room, rng)),
        ("building, easy guesses", built.pairs, built.walls, guesses(built.pairs, EASY, rng)),
    ]
    records: list[Record] = []
    for data, pairs, walls, seeds in cases:
        for name, matcher in matchers.items():
            matched, errors = matches_and_errors(pairs, match_all(matcher, pairs, seeds)[0])
            good = within_limits(errors)
            right = [pair for (pair, _), is_good in zip(matched, good, strict=True) if is_good]
            shares = calibration.efficiency(right, walls, errors[good]) if right else (None, None)
            records.append({"data": data, "matcher": name, "translation": shares[0], "rotation": shares[1]})
    return records


def speed_records(
    sets: Sequence[PairSet], matchers: Mapping[str, Matcher], rng: np.random.Generator
) -> list[Record]:
    """Times of all matchers in turns, by what is counted in, and how many times as long small_gicp takes."""
    records: list[Record] = []
    for kind in sets:
        times = cost.match_times(matchers, kind.pairs, guesses(kind.pairs, EASY, rng))
        for name, ms in times.items():
            ratios = {f"{way}_ratio": times[GICP][way] / ms[way] if GICP in times else None for way in ms}
            records.append({"data": kind.name, "matcher": name} | ms | ratios)
    return records
