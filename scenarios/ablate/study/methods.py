"""How good the map of a whole drive becomes, by scenario and method, on the same drives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from scenarios import source
from scenarios.ablate.injection import map_with_false_stitches
from scenarios.ablate.options import MethodsOptions
from scenarios.ablate.statistics import NAN, median_interval
from scenarios.evaluation import DEFINITIONS, evaluate
from scenarios.evaluation.trajectory import band, last_squared_error
from scenarios.jsonable import document
from scenarios.methods import METHODS, OURS, load_kernels
from scenarios.methods.config import MethodConfig
from scenarios.methods.warm_up import warm_up_recording
from scenarios.options import parse_names
from scenarios.stages import timed
from scenarios.sweep import Answer, Failure, Trial, finish, write_results
from slam.cli import InputError
from slam.graph.pose_graph import Loss
from slam.recording import Recording
from slam.table import ABSENT, Columns, Table, number, with_interval
from stitch.mapping import Estimate, NoEstimate
from stitch.mapping.submap_graph import BACK_ENDS

BOOTSTRAP_SEED = 0
DEFAULT_BACK_END: Loss = "gnc"
ERROR = "ate_rmse"
LAST = "nees_last"
"""Besides the metrics by their names: the squared error of the last pose over its covariance."""
EVERYWHERE = "all"
"""The scenario of all scenarios together."""
BETTER_OF = ("ins", "wsm")
"""Our method is also compared with the better of these on each drive."""
BETTER = f"better of {' and '.join(BETTER_OF)}"
NOTES = (
    "worst: of all drives (which seed); false: of the accepted stitches, off by more than 0.3 m or 2°; "
    "s: median processor time",
    "ANEES: mean over drives of their poses' average, 1 is honest; at end: of the last poses alone, with the "
    "band in which 95 % of honest ones lie",
    "ratio: of ate_rmse on the same drive, below 1 where the first is better: median [95 % interval]",
)


def run(options: MethodsOptions) -> None:
    """Every method on every drive, and what came of it. Exits with 1 when a trial failed."""
    scenarios, seeds, variants = checked(options)
    trials = [variant.trial(*drive) for drive in product(scenarios, seeds) for variant in variants]
    swept = options.sweep(trials, run_trial, prepare=simulate_recording)
    results = [DriveResult.of(*both) for both in zip(swept.trials, swept.answers, strict=True)]
    known = {name for result in results for name in result.values}
    about = ["scenario", "seed", "method", "seconds", "error"]
    rows = ({name: getattr(result, name) for name in about} | result.values for result in results)
    columns = [*about, *(name for name in [*DEFINITIONS, LAST] if name in known)]
    write_results(options.out / "results.csv", columns, rows)
    summaries = summarise(results)
    ratios = compare_methods(results, variants, np.random.default_rng(BOOTSTRAP_SEED))
    if options.format == "json":
        failed = [{name: getattr(r, name) for name in about if name != "seconds"} for r in results if r.error]
        content = {"standings": summaries, "comparisons": ratios, "failed": failed}
        print(document(study="methods", scenarios=scenarios, seeds=seeds, **content))
    else:
        print_ranking(f"methods: seeds {options.seeds}", summaries, ratios)
    finish(swept, options.store)


def checked(options: MethodsOptions) -> tuple[list[str], list[int], tuple[MethodVariant, ...]]:
    """Scenarios, seeds and variants of methods. Raises `InputError`."""
    methods = parse_names(options.methods, METHODS, "method")
    back_ends = parse_names(options.variant, BACK_ENDS, "variant", "--variant")
    if not 0.0 <= options.inject < 1.0:
        raise InputError(f"--inject {options.inject:g}: expected a share of at least 0 and below 1")
    if OURS not in methods and (options.inject > 0.0 or options.variant != MethodsOptions.variant):
        raise InputError(f"--variant and --inject are for {OURS}: expected it among --methods")
    return *options.checked(count=True), method_variants(methods, back_ends, options.inject)  # type: ignore[arg-type]


@dataclass(frozen=True)
class MethodVariant:
    """A method under the ``name`` that tables call it by; ``back_end`` and the share of stitches ``injected``
    are read by ours only; ``clean`` names the variant without injection, None where nothing is injected."""

    name: str
    method: str
    back_end: Loss = DEFAULT_BACK_END
    injected: float = 0.0
    clean: str | None = None

    def config(self) -> MethodConfig:
        """The method's settings."""
        default = MethodConfig()
        loops = replace(default.slam.loops, back_end=self.back_end)
        return replace(default, slam=replace(default.slam, loops=loops))

    def run(self, recording: Recording, seed: int) -> Estimate | NoEstimate:
        """What the method says of a drive; ``seed`` draws what is injected."""
        if self.injected > 0.0:
            rng = np.random.default_rng(seed)
            return map_with_false_stitches(recording, self.config().slam, self.injected, rng)
        return METHODS[self.method](recording, self.config())

    def trial(self, scenario: str, seed: int) -> Trial:
        """The variant on one drive, as a trial of the study."""
        settings = {"method": self.method, "back_end": self.back_end, "injected": self.injected}
        return Trial("methods", scenario, seed, self.name, settings)


def method_variants(
    methods: Sequence[str], back_ends: Sequence[Loss], injected: float
) -> tuple[MethodVariant, ...]:
    """Every method; ours with each back end, and again with a share of ``injected`` false stitches if any."""
    variants = []
    for method in methods:
        for back_end in back_ends if method == OURS else (DEFAULT_BACK_END,):
            name = method if back_end == DEFAULT_BACK_END else f"{method} {back_end}"
            variants.append(MethodVariant(name, method, back_end))
            if method == OURS and injected > 0.0:
                variants.append(MethodVariant(f"{name} +{injected:.0%}", OURS, back_end, injected, name))
    return tuple(variants)


def simulate_recording(scenario: str, seed: int) -> Recording:
    """The recording of a scenario's name and seed."""
    return source.simulated(scenario, seed).recording


def run_trial(trial: Trial, recording: Recording) -> Answer:
    """A trial's variant on its drive: one row, its metrics and processor time [s] without loading kernels."""
    variant = MethodVariant(trial.method, **trial.config)
    load_kernels(variant.method, warm_up_recording(recording), variant.config())
    estimate, seconds = timed(variant.run, recording, trial.seed)
    if isinstance(estimate, NoEstimate):
        raise ValueError(f"{estimate.method}: {estimate.reason}")
    metrics = evaluate(recording, [estimate])
    values = {metric.name: metric.value for metric in metrics if metric.value is not None}
    if recording.truth is not None:
        values[LAST] = last_squared_error(estimate.poses, estimate.covariance, recording.truth)
    return Answer([{"values": values, "seconds": seconds}])


@dataclass(frozen=True)
class DriveResult:
    """One variant on one drive: the metrics that could be computed, by name, and ``seconds`` of processor
    time; ``error`` tells what went wrong, and is empty where nothing did."""

    scenario: str
    seed: int
    method: str
    values: dict[str, float] = field(default_factory=dict)
    seconds: float = NAN
    error: str = ""

    @classmethod
    def of(cls, trial: Trial, outcome: Answer | Failure) -> DriveResult:
        """What a trial came to."""
        about = trial.scenario, trial.seed, trial.method
        if isinstance(outcome, Failure):
            return cls(*about, error=outcome.line)
        return cls(*about, **outcome.rows[0])

    def value(self, name: str) -> float:
        """A metric, NaN where there is none."""
        return self.values.get(name, NAN)


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
    """``method`` against ``against`` on the same drives: the median of the ratios of `ERROR` with its 95 %
    bootstrap interval, the share of drives on which it is better (below 1), and the worst drive."""

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


Values = Mapping[tuple[str, int], float]
"""A number by drive, its scenario and seed."""


def _finite(results: Sequence[DriveResult], name: str) -> Values:
    return {(r.scenario, r.seed): r.value(name) for r in results if np.isfinite(r.value(name))}


def _summary(scenario: str, method: str, results: Sequence[DriveResult]) -> MethodSummary:
    done = [result for result in results if not result.error]
    errors, maps, last = (_finite(done, name) for name in (ERROR, "map_f1", LAST))
    worst_ate, worst_map = _worst(errors, 1.0), _worst(maps, -1.0)
    return MethodSummary(
        scenario=scenario,
        method=method,
        drives=len(done),
        failed=len(results) - len(done),
        ate_rmse=_of(np.median, errors),
        worst_ate_rmse=worst_ate[0],
        worst_ate_drive=worst_ate[1],
        map_f1=_of(np.median, maps),
        worst_map_f1=worst_map[0],
        worst_map_drive=worst_map[1],
        accepted=_total(_finite(done, "stitches_accepted")),
        false=_total(_finite(done, "stitches_false")),
        anees=_of(np.mean, _finite(done, "anees")),
        anees_last=_of(np.mean, last) / 3.0,
        band=band(len(last)) if last else (NAN, NAN),
        seconds=float(np.median([result.seconds for result in done])) if done else NAN,
    )


def _of(statistic: Callable[[list[float]], Any], values: Values) -> float:
    """A statistic over drives, NaN where there is none."""
    return float(statistic(list(values.values()))) if values else NAN


def _worst(values: Values, sign: float) -> tuple[float, str]:
    """The largest of ``sign`` times the values, and its drive."""
    worst = max(values, key=lambda drive: sign * values[drive], default=None)
    return (NAN, "") if worst is None else (values[worst], "{} {}".format(*worst))


def _total(values: Values) -> int | None:
    return int(sum(values.values())) if values else None


def compare_methods(
    results: Sequence[DriveResult], variants: Sequence[MethodVariant], rng: np.random.Generator
) -> list[PairedRatio]:
    """Our first variant against all others and the better of `BETTER_OF`, and every variant with false
    stitches against itself without; by scenario, and over all. ``rng`` draws the bootstrap."""
    compared = []
    for scenario, inside in by_scenario(results):
        errors = {v.name: _finite([r for r in inside if r.method == v.name], ERROR) for v in variants}
        if set(BETTER_OF) <= set(errors):
            first, second = (errors[name] for name in BETTER_OF)
            errors[BETTER] = {drive: min(first[drive], second[drive]) for drive in first if drive in second}
        for method, against in _couples(variants):
            own, other = errors[method], errors[against]
            if ratios := {drive: own[drive] / other[drive] for drive in own if drive in other}:
                values = np.array(list(ratios.values()))
                about = scenario, method, against, len(values)
                median, interval = float(np.median(values)), median_interval(values, rng)
                better, worst = float(np.mean(values < 1.0)), _worst(ratios, 1.0)
                compared.append(PairedRatio(*about, median, interval, better, *worst))
    return compared


def _couples(variants: Sequence[MethodVariant]) -> Iterator[tuple[str, str]]:
    """Names of what is compared with what."""
    ours = next((variant.name for variant in variants if variant.method == OURS), None)
    if ours is not None:
        yield from ((ours, one.name) for one in variants if one.clean is None and one.name != ours)
        if set(BETTER_OF) <= {variant.name for variant in variants}:
            yield ours, BETTER
    yield from ((one.name, one.clean) for one in variants if one.clean is not None)


def _worst_text(one: MethodSummary, value: float, drive: str, decimals: int) -> str:
    """A worst value and its drive, of which the scenario need not be said twice."""
    return f"{number(value, decimals)} ({drive.removeprefix(one.scenario).strip()})" if drive else ABSENT


SUMMARY_COLUMNS: Columns = (
    ("scenario", lambda one: one.scenario),
    ("method", lambda one: one.method),
    ("drives", lambda one: f"{one.drives} ({one.failed} failed)" if one.failed else f"{one.drives}"),
    ("ate_rmse", lambda one: number(one.ate_rmse, 3)),
    ("worst", lambda one: _worst_text(one, one.worst_ate_rmse, one.worst_ate_drive, 3)),
    ("map_f1", lambda one: number(one.map_f1, 2)),
    ("worst", lambda one: _worst_text(one, one.worst_map_f1, one.worst_map_drive, 2)),
    ("false", lambda one: ABSENT if one.accepted is None else f"{one.false}/{one.accepted}"),
    ("ANEES", lambda one: number(one.anees, 2)),
    ("at end", lambda one: with_interval(one.anees_last, *one.band)),
    ("s", lambda one: number(one.seconds, 1)),
)
RATIO_COLUMNS: Columns = (
    ("scenario", lambda one: one.scenario),
    ("method", lambda one: one.method),
    ("against", lambda one: one.against),
    ("drives", lambda one: str(one.drives)),
    ("ratio", lambda one: with_interval(one.ratio, *one.interval)),
    ("better", lambda one: f"{one.better:.0%}"),
    ("worst", lambda one: number(one.worst, 2)),
    ("where", lambda one: one.worst_drive),
)


def print_ranking(title: str, summaries: Sequence[MethodSummary], ratios: Sequence[PairedRatio]) -> None:
    """A row per scenario and method, one per comparison on the same drives, and what their columns mean."""
    notes = () if ratios else NOTES
    Table.of(summaries, SUMMARY_COLUMNS, title, names=2, notes=notes).grouped().print()
    if ratios:
        Table.of(ratios, RATIO_COLUMNS, "On the same drives", names=3, notes=NOTES).grouped().print()
