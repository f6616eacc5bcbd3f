"""Results of drives as medians, worst cases and paired ratios, by scenario and method; as tables and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.ablate.method_variants import LAST, OURS, DriveResult, MethodVariant
from scenarios.ablate.statistics import NAN, median_interval
from scenarios.evaluation.trajectory import band
from scenarios.jsonable import jsonable
from slam.table import ABSENT, Table, number, with_interval

EVERYWHERE = "all"
"""The scenario of all scenarios together."""
BETTER_OF = ("ins", "wsm")
"""Our method is also compared with the better of these on each drive."""
BETTER = f"better of {' and '.join(BETTER_OF)}"
ERROR = "ate_rmse"
COLUMNS = (
    "scenario", "method", "drives", "ate_rmse", "worst", "map_f1", "worst", "false", "ANEES", "at end", "s",
)  # fmt: skip
NOTES = (
    "worst: of all drives (which seed); false: of the accepted stitches, off by more than 0.3 m or 2°; "
    "s: median processor time",
    "ANEES: mean over drives of their poses' average, 1 is honest; at end: of the last poses alone, with the "
    "band in which 95 % of honest ones lie",
    "ratio: of ate_rmse on the same drive, below 1 where the first is better: median [95 % interval]",
)


Errors = Mapping[tuple[str, int], float]
"""`ERROR` by drive, its scenario and seed."""


@dataclass(frozen=True)
class MethodSummary:
    """One method in one scenario: medians over ``drives``, and the worst, which is named.

    ``accepted`` and ``false`` stitches of all drives together, None where it does not stitch. ``anees`` is
    the mean over drives, each the average over its poses, / 3; ``anees_last`` that of the last poses, which
    are independent and of which 95 % lie within ``band`` if the covariances are honest. NaN where there is
    nothing.
    """

    scenario: str
    method: str
    drives: int
    failed: int
    ate_rmse: float
    worst_ate_rmse: float
    worst_ate_drive: str
    map_f1: float
    worst_map_f1: float
    worst_map_drive: str
    accepted: int | None
    false: int | None
    anees: float
    anees_last: float
    band: tuple[float, float]
    seconds: float


@dataclass(frozen=True)
class PairedRatio:
    """``method`` against ``against`` on the same drives: ratios of `ERROR`, below 1 where it is better.

    The median ratio with its 95 % interval (bootstrap over the drives, NaN of a single one), the share of
    drives on which it is better, and the worst drive.
    """

    scenario: str
    method: str
    against: str
    drives: int
    ratio: float
    interval: tuple[float, float]
    better: float
    worst: float
    worst_drive: str


def by_scenario(results: Sequence[DriveResult]) -> Iterator[tuple[str, list[DriveResult]]]:
    """The results of each scenario, in their order, and of all together where there are several."""
    scenarios = list(dict.fromkeys(result.scenario for result in results))
    for scenario in scenarios:
        yield scenario, [result for result in results if result.scenario == scenario]
    if len(scenarios) > 1:
        yield EVERYWHERE, list(results)


def summarise(results: Sequence[DriveResult]) -> list[MethodSummary]:
    """A summary per scenario and method, and per method over all scenarios."""
    return [
        _summary(scenario, method, [result for result in inside if result.method == method])
        for scenario, inside in by_scenario(results)
        for method in dict.fromkeys(result.method for result in inside)
    ]


def _summary(scenario: str, method: str, results: Sequence[DriveResult]) -> MethodSummary:
    done = [result for result in results if not result.error]
    worst_ate, worst_ate_drive = _worst_drive(done, ERROR, 1.0)
    worst_map, worst_map_drive = _worst_drive(done, "map_f1", -1.0)
    last = _finite(done, LAST)
    return MethodSummary(
        scenario=scenario,
        method=method,
        drives=len(done),
        failed=len(results) - len(done),
        ate_rmse=_median(_finite(done, ERROR)),
        worst_ate_rmse=worst_ate,
        worst_ate_drive=worst_ate_drive,
        map_f1=_median(_finite(done, "map_f1")),
        worst_map_f1=worst_map,
        worst_map_drive=worst_map_drive,
        accepted=_total(done, "stitches_accepted"),
        false=_total(done, "stitches_false"),
        anees=_mean(_finite(done, "anees")),
        anees_last=_mean(last) / 3.0,
        band=band(len(last)) if len(last) else (NAN, NAN),
        seconds=_median(np.array([result.seconds for result in done])),
    )


def compare_methods(
    results: Sequence[DriveResult], variants: Sequence[MethodVariant], rng: np.random.Generator
) -> list[PairedRatio]:
    """Our first variant against all others and the better of `BETTER_OF`, and every variant with false
    stitches against itself without; by scenario, and over all. ``rng`` draws the bootstrap."""
    compared = []
    for scenario, inside in by_scenario(results):
        errors = {variant.name: _errors(inside, variant.name) for variant in variants}
        if set(BETTER_OF) <= set(errors):
            errors[BETTER] = _least([errors[name] for name in BETTER_OF])
        for method, against in _couples(variants):
            own, other = errors[method], errors[against]
            if shared := [drive for drive in own if drive in other]:
                ratios = np.array([own[drive] / other[drive] for drive in shared])
                compared.append(_ratio(scenario, method, against, shared, ratios, rng))
    return compared


def _couples(variants: Sequence[MethodVariant]) -> Iterator[tuple[str, str]]:
    """Names of what is compared with what."""
    ours = next((variant.name for variant in variants if variant.method == OURS), None)
    if ours is not None:
        yield from ((ours, one.name) for one in variants if one.clean is None and one.name != ours)
        if set(BETTER_OF) <= {variant.name for variant in variants}:
            yield ours, BETTER
    yield from ((one.name, one.clean) for one in variants if one.clean is not None)


def _ratio(
    scenario: str,
    method: str,
    against: str,
    drives: Sequence[tuple[str, int]],
    ratios: np.ndarray,
    rng: np.random.Generator,
) -> PairedRatio:
    worst = int(np.argmax(ratios))
    return PairedRatio(
        scenario,
        method,
        against,
        drives=len(ratios),
        ratio=float(np.median(ratios)),
        interval=median_interval(ratios, rng),
        better=float(np.mean(ratios < 1.0)),
        worst=float(ratios[worst]),
        worst_drive="{} {}".format(*drives[worst]),
    )


def _errors(results: Sequence[DriveResult], method: str) -> Errors:
    own = (result for result in results if result.method == method and np.isfinite(result.value(ERROR)))
    return {(result.scenario, result.seed): result.value(ERROR) for result in own}


def _least(several: Sequence[Errors]) -> Errors:
    """The least error on every drive that all of them finished."""
    shared = [drive for drive in several[0] if all(drive in errors for errors in several)]
    return {drive: min(errors[drive] for errors in several) for drive in shared}


def _finite(results: Sequence[DriveResult], name: str) -> np.ndarray:
    values = np.array([result.value(name) for result in results])
    return values[np.isfinite(values)]


def _worst_drive(results: Sequence[DriveResult], name: str, sign: float) -> tuple[float, str]:
    known = [result for result in results if np.isfinite(result.value(name))]
    worst = max(known, key=lambda result: sign * result.value(name), default=None)
    return (NAN, "") if worst is None else (worst.value(name), worst.name)


def _total(results: Sequence[DriveResult], name: str) -> int | None:
    values = _finite(results, name)
    return int(values.sum()) if len(values) else None


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else NAN


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else NAN


def ranking_table(title: str, summaries: Sequence[MethodSummary], notes: Sequence[str] = ()) -> Table:
    """A row per scenario and method."""
    rows = [
        (
            one.scenario,
            one.method,
            f"{one.drives}" if one.failed == 0 else f"{one.drives} ({one.failed} failed)",
            number(one.ate_rmse, 3),
            _worst(one.worst_ate_rmse, one.worst_ate_drive, one.scenario, 3),
            number(one.map_f1, 2),
            _worst(one.worst_map_f1, one.worst_map_drive, one.scenario, 2),
            ABSENT if one.accepted is None else f"{one.false}/{one.accepted}",
            number(one.anees, 2),
            with_interval(one.anees_last, *one.band),
            number(one.seconds, 1),
        )
        for one in summaries
    ]
    return Table(COLUMNS, rows, title, names=2, notes=notes).grouped()


def ratio_table(ratios: Sequence[PairedRatio]) -> Table:
    """A row per comparison on the same drives."""
    rows = [
        (
            one.scenario,
            one.method,
            one.against,
            str(one.drives),
            with_interval(one.ratio, *one.interval),
            f"{one.better:.0%}",
            number(one.worst, 2),
            one.worst_drive,
        )
        for one in ratios
    ]
    columns = ("scenario", "method", "against", "drives", "ratio", "better", "worst", "where")
    return Table(columns, rows, "On the same drives", names=3, notes=NOTES).grouped()


def _worst(value: float, drive: str, scenario: str, decimals: int) -> str:
    """A worst value and its drive, of which the scenario need not be said twice."""
    return f"{number(value, decimals)} ({drive.removeprefix(scenario).strip()})" if drive else ABSENT


def print_ranking(title: str, summaries: Sequence[MethodSummary], ratios: Sequence[PairedRatio]) -> None:
    """Both tables on stdout, and what their columns mean."""
    ranking_table(title, summaries, () if ratios else NOTES).print()
    if ratios:
        ratio_table(ratios).print()


def ranking_json(
    summaries: Sequence[MethodSummary],
    ratios: Sequence[PairedRatio],
    failed: Sequence[DriveResult],
    about: Mapping[str, object],
) -> str:
    """The same as one object; a number that does not exist is null."""
    errors = [
        {"scenario": one.scenario, "seed": one.seed, "method": one.method, "error": one.error}
        for one in failed
    ]
    content = {"schema": 1, **about, "standings": summaries, "comparisons": ratios, "failed": errors}
    return json.dumps(jsonable(content), indent=2)
