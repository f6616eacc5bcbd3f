"""Whether a map knows without truth that it is torn: `self_consistency` against the true error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product

import numpy as np

from scenarios import source
from scenarios.ablate.options import SelfConsistencyOptions
from scenarios.ablate.statistics import NAN
from scenarios.evaluation.detection import Decision, decided, roc_auc
from scenarios.evaluation.self_consistency import with_self_consistency
from scenarios.evaluation.trajectory import trajectory_metrics
from scenarios.jsonable import document
from scenarios.methods import METHODS, OURS
from scenarios.methods.config import MethodConfig
from scenarios.options import parse_names
from scenarios.sweep import Answer, Trial, finish, write_results
from sim.corruption import CORRUPTIONS, corrupt
from slam.cli import InputError
from slam.recording import Recording
from slam.table import Columns, Table, number
from stitch.mapping import NoEstimate

HONEST = "honest"
"""What a recording is called that says what it is."""
LEAST_YAW = 0.5
"""A heading error below this [°] is none: that of an honest drive is often next to nothing."""
ALL = "all"
NOTES = (
    "torn: ate_rmse more than so many times that of slamstitch on the honest drive; AUC: chance that a torn "
    "map has the lower self_consistency",
    "AUC, heading too: torn where yaw_rmse is so many times worse as well (a map can be torn by headings "
    "alone: dead reckoning of an INS)",
    "no figure: drives that come back to no place; found, alarms: by the verdict (self_consistency < 0.5)",
)


def run(options: SelfConsistencyOptions) -> None:
    """Every method on every drive, spoilt in every way, and whether it knew. Exits with 1 when a trial
    failed."""
    scenarios, seeds = options.checked(count=True)
    kinds = parse_names(options.corruptions, CORRUPTIONS, "corruption", "--corruptions")
    methods = parse_names(options.methods, METHODS, "method")
    if not options.times > 1.0:
        raise InputError(f"--times {options.times:g}: expected more than 1")
    swept = options.sweep(trials(scenarios, seeds, kinds, methods), run_trial, prepare=simulate_recording)
    maps = [
        MadeMap(**row) for _, answer in swept.answered if isinstance(answer, Answer) for row in answer.rows
    ]
    columns = list(MadeMap.__annotations__)
    write_results(options.out / "results.csv", columns, (asdict(one) for one in maps))
    found = summarise(maps, options.times)
    if options.format == "json":
        print(document(study="self_consistency", scenarios=scenarios, seeds=seeds, found=found))
    else:
        title = f"self_consistency: seeds {options.seeds}, torn from × {options.times:g}"
        Table.of(found, COLUMNS, title, names=1, notes=NOTES).print()
    finish(swept, options.store)


def trials(
    scenarios: Sequence[str], seeds: Sequence[int], corruptions: Sequence[str], methods: Sequence[str]
) -> list[Trial]:
    """Every method on every drive and corruption, and ours on every honest drive."""
    both = [(method, kind) for kind, method in product((HONEST, *corruptions), methods)]
    if (OURS, HONEST) not in both:
        both.insert(0, (OURS, HONEST))
    return [
        Trial("self_consistency", scenario, seed, method, {"corruption": kind})
        for scenario, seed in product(scenarios, seeds)
        for method, kind in both
    ]


def simulate_recording(scenario: str, seed: int) -> Recording:
    """The recording of a scenario's name and seed."""
    return source.simulated(scenario, seed).recording


@dataclass(frozen=True)
class MadeMap:
    """What a method made of a drive: its true errors [m], [°], and what it says of itself, NaN where it has
    no figure."""

    scenario: str
    seed: int
    corruption: str
    method: str
    ate_rmse: float
    yaw_rmse: float
    figure: float
    places: int


def run_trial(trial: Trial, recording: Recording) -> Answer:
    """One method on one drive, spoilt or not; no row where it has no answer."""
    kind = trial.config["corruption"]
    if kind != HONEST:
        rng = np.random.default_rng([trial.seed, list(CORRUPTIONS).index(kind)])
        recording = corrupt(recording, [CORRUPTIONS[kind].at()], rng)
    config = MethodConfig()
    estimate = METHODS[trial.method](recording, config)
    if isinstance(estimate, NoEstimate):
        return Answer([])
    consistency = with_self_consistency(estimate, recording, config.self_consistency).consistency
    assert consistency is not None
    figure = NAN if consistency.figure is None else consistency.figure
    errors = trajectory_metrics(estimate.poses, recording.truth)
    about = trial.scenario, trial.seed, kind, trial.method
    made = MadeMap(
        *about, float(errors["ate_rmse"]), float(errors["yaw_rmse"]), figure, len(consistency.places)
    )
    return Answer([asdict(made)])


@dataclass(frozen=True)
class Found:
    """How well the maps of a method know that they are torn: ``maps`` with a figure, ``without`` one, those
    ``torn``; areas under the ROC curve by position and by heading too; torn maps ``found`` and ``alarms``
    that were false."""

    method: str
    maps: int
    without: int
    torn: int
    auc: float
    auc_heading: float
    found: int
    alarms: int


def summarise(maps: Sequence[MadeMap], times: float) -> list[Found]:
    """Per method, and of all together where there are several."""
    clean = {(m.scenario, m.seed): m for m in maps if (m.method, m.corruption) == (OURS, HONEST)}
    known = [m for m in maps if (m.scenario, m.seed) in clean]
    methods = list(dict.fromkeys(m.method for m in known))
    found = [_found(method, [m for m in known if m.method == method], clean, times) for method in methods]
    return found if len(methods) < 2 else [*found, _found(ALL, known, clean, times)]


def _found(
    method: str, maps: Sequence[MadeMap], clean: dict[tuple[str, int], MadeMap], times: float
) -> Found:
    told = [m for m in maps if np.isfinite(m.figure)]
    honest = [clean[m.scenario, m.seed] for m in told]
    figure = np.array([m.figure for m in told])
    torn = np.array([m.ate_rmse > times * h.ate_rmse for m, h in zip(told, honest, strict=True)], dtype=bool)
    turned = np.array(
        [m.yaw_rmse > times * max(h.yaw_rmse, LEAST_YAW) for m, h in zip(told, honest, strict=True)],
        dtype=bool,
    )
    decision: Decision = decided(figure < 0.5, torn)
    return Found(
        method,
        len(told),
        len(maps) - len(told),
        int(torn.sum()),
        roc_auc(-figure, torn),
        roc_auc(-figure, torn | turned),
        decision.right,
        decision.wrong,
    )


COLUMNS: Columns = (
    ("method", lambda one: one.method),
    ("maps", lambda one: str(one.maps)),
    ("no figure", lambda one: str(one.without)),
    ("torn", lambda one: str(one.torn)),
    ("AUC", lambda one: number(one.auc, 3)),
    ("AUC, heading too", lambda one: number(one.auc_heading, 3)),
    ("found", lambda one: f"{one.found} of {one.torn}"),
    ("false alarms", lambda one: f"{one.alarms} of {one.maps - one.torn}"),
)
