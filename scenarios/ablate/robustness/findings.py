"""What the answers of the study come to: ratios to the clean drive, worst first, and sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from scenarios.ablate.robustness.trials import Log
from scenarios.ablate.statistics import NAN, median_interval
from scenarios.methods import BASELINE, OURS
from scenarios.sweep import Answer, Failure, Trial

SEED = 0
"""Of the generator that intervals draw from."""
SCORES = ("ate_rmse", "relation_trans_mean")
"""What a drive is scored by: the first where there is truth, else the second [m]."""
UNHURT, HURT = 1.3, 3.0
"""Ratios up to which a method is said to be hardly and moderately hurt."""
JUDGED = "medium"
"""The level that sentences are about; what is there or not counts as of it."""


@dataclass(frozen=True)
class DriveResult:
    """One method on one drive, spoilt in one way: its metrics by name and ``seconds`` of processor time, or
    why it ``refused``, why the recording is ``unfit`` for the corruption, or the ``failure``."""

    scenario: str
    seed: int
    method: str
    corruption: str = ""
    level: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    seconds: float = NAN
    refused: str = ""
    unfit: str = ""
    failure: str = ""

    @classmethod
    def of(cls, trial: Trial, outcome: Answer | Failure) -> DriveResult:
        """What a trial came to."""
        how = trial.config["corruption"], trial.config["level"]
        about = trial.scenario, trial.seed, trial.method, *how
        if isinstance(outcome, Failure):
            return cls(*about, failure=outcome.line)
        return cls(*about, **outcome.rows[0])

    @property
    def error(self) -> float:
        """The first of `SCORES` that there is, NaN without an answer."""
        return next((self.values[name] for name in SCORES if name in self.values), NAN)

    @property
    def drive(self) -> str:
        """The drive in words."""
        return f"{self.scenario} {self.seed}"


@dataclass(frozen=True)
class RatioSummary:
    """One method under one corruption: the errors over those on the same drives when clean.

    Median over ``drives`` with its 95 % bootstrap ``interval``, and the ``worst``, with its drive. On
    ``refused`` drives the method had no answer, on ``failed`` ones it broke.
    """

    corruption: str
    level: str
    method: str
    drives: int
    median: float
    interval: tuple[float, float]
    worst: float
    worst_drive: str
    refused: int
    failed: int


@dataclass(frozen=True)
class CleanSummary:
    """One method on the clean drives of one scenario, or on one log: median and largest error [m]."""

    scenario: str
    method: str
    drives: int
    median: float
    worst: float
    refused: int
    failed: int


@dataclass(frozen=True)
class Findings:
    """All results, and what they come to: of ``methods`` the first is `judged`; ``rows`` are by corruption,
    the one that hurts it most first, and then by method."""

    results: Sequence[DriveResult]
    methods: Sequence[str]
    clean: Sequence[CleanSummary]
    rows: Sequence[Sequence[RatioSummary]]

    @property
    def judged(self) -> str:
        """The method that the study is about: ours, or the first one asked for."""
        return self.methods[0]

    def of(self, method: str) -> list[RatioSummary]:
        """A method's rows."""
        return [one for row in self.rows for one in row if one.method == method]


def analyse(results: Sequence[DriveResult], logs: Mapping[str, Log]) -> Findings:
    """What the results come to; ``logs`` are the scenarios that are read."""
    asked = dict.fromkeys(result.method for result in results)
    methods = sorted(asked, key=lambda method: method != OURS)
    clean = {_key(r, logs): r.error for r in results if not r.corruption}
    rng, rows = np.random.default_rng(SEED), []
    for corruption in dict.fromkeys(r.corruption for r in results if r.corruption):
        inside = [r for r in results if r.corruption == corruption and not r.unfit]
        by_method = ([r for r in inside if r.method == method] for method in methods)
        rows.append([_ratios(own, clean, logs, rng) for own in by_method if own])
    rows = sorted(filter(None, rows), key=_hurt, reverse=True)
    return Findings(results, methods, _clean(results, methods), rows)


def _key(result: DriveResult, logs: Mapping[str, Log]) -> tuple[str, int | None, str]:
    """What a spoilt result and its clean one have in common: a log is the same whatever the seed."""
    return result.scenario, None if result.scenario in logs else result.seed, result.method


def _ratios(
    results: Sequence[DriveResult],
    clean: Mapping[tuple[str, int | None, str], float],
    logs: Mapping[str, Log],
    rng: np.random.Generator,
) -> RatioSummary:
    ratios = {r.drive: r.error / clean.get(_key(r, logs), NAN) for r in results}
    known = {drive: ratio for drive, ratio in ratios.items() if np.isfinite(ratio)}
    values = np.array(list(known.values()))
    worst = max(known, key=known.__getitem__, default="")
    first = results[0]
    return RatioSummary(
        corruption=first.corruption,
        level=first.level,
        method=first.method,
        drives=len(values),
        median=float(np.median(values)) if len(values) else NAN,
        interval=median_interval(values, rng),
        worst=known.get(worst, NAN),
        worst_drive=worst,
        refused=sum(bool(r.refused) for r in results),
        failed=sum(bool(r.failure) for r in results),
    )


def _hurt(row: Sequence[RatioSummary]) -> tuple[float, float]:
    """What rows are sorted by; without any answer a row comes first, as nothing is left."""
    median, worst = row[0].median, row[0].worst
    return (median, worst) if np.isfinite(median) else (np.inf, np.inf)


def _clean(results: Sequence[DriveResult], methods: Sequence[str]) -> list[CleanSummary]:
    found = []
    for scenario in dict.fromkeys(r.scenario for r in results):
        for method in methods:
            own = [r for r in results if (r.scenario, r.method, r.corruption) == (scenario, method, "")]
            errors = np.array([r.error for r in own if np.isfinite(r.error)])
            middle, worst = (float(np.median(errors)), float(errors.max())) if len(errors) else (NAN, NAN)
            refused, failed = sum(bool(r.refused) for r in own), sum(bool(r.failure) for r in own)
            found.append(CleanSummary(scenario, method, len(errors), middle, worst, refused, failed))
    return found


def verdict(findings: Findings) -> list[str]:
    """Sentences: what hurts most, what does not hurt, who else is hurt, and what has no answer."""
    if not findings.rows:
        return ["No corruption fits any of the recordings: nothing was spoilt."]
    sentences = [_of_method(findings, method) for method in findings.methods]
    sentences += [_against(findings, method) for method in findings.methods[1:]]
    sentences += _without_answer(findings)
    return sentences


def _of_method(findings: Findings, method: str) -> str:
    rows = [one for one in findings.of(method) if np.isfinite(one.median)]
    if not rows:
        return f"{method} has no answer on any spoilt drive."
    worst = max(rows, key=lambda one: one.median)
    text = (
        f"{method} is hurt most by {worst.corruption}: × {_factor(worst.median)} in the median of "
        f"{worst.drives} drives, × {_factor(worst.worst)} on {worst.worst_drive}."
    )
    judged = [one for one in rows if one.level in ("", JUDGED)]
    if not judged:
        return text
    unhurt = sum(one.median <= UNHURT for one in judged)
    hurt = sorted((one for one in judged if one.median > HURT), key=lambda one: -one.median)
    text += (
        f" Under {unhurt} of {len(judged)} corruptions at {JUDGED} severity its error stays within "
        f"× {UNHURT:g} of the clean one"
    )
    if not hurt:
        return f"{text}; none takes it beyond × {HURT:g}."
    names = ", ".join(f"{one.corruption} (× {_factor(one.median)})" for one in hurt)
    return f"{text}; beyond × {HURT:g}: {names}."


def _against(findings: Findings, other: str) -> str:
    """On how many spoilt drives another method is nearer to the truth."""
    errors: dict[str, dict[tuple[str, str], float]] = {findings.judged: {}, other: {}}
    for r in findings.results:
        if r.method in errors and r.corruption and np.isfinite(r.error):
            errors[r.method][r.corruption, r.drive] = r.error
    ours, theirs = errors[findings.judged], errors[other]
    both = [key for key in ours if key in theirs]
    behind = [key for key in both if ours[key] > theirs[key]]
    what = "dead reckoning as recorded" if other == BASELINE else other
    if not both:
        return f"No spoilt drive has an answer of both {findings.judged} and {what}."
    text = f"{findings.judged} is worse than {what} on {len(behind)} of {len(both)} spoilt drives"
    if not behind:
        return f"{text}."
    most = max(behind, key=lambda key: ours[key] / max(theirs[key], 1e-12))
    return f"{text}, most on {most[1]} with {most[0]}: {ours[most]:.3f} m against {theirs[most]:.3f} m."


def _without_answer(findings: Findings) -> list[str]:
    sentences = []
    for method in findings.methods:
        own = [r for r in findings.results if r.method == method and r.corruption]
        refused, failed = [r for r in own if r.refused], [r for r in own if r.failure]
        if refused:
            kinds = ", ".join(dict.fromkeys(r.corruption for r in refused))
            sentences.append(f"{method} refuses to answer on {len(refused)} spoilt drives: {kinds}.")
        if failed:
            sentences.append(
                f"{method} broke on {len(failed)} spoilt drives, first with {failed[0].failure}."
            )
    unfit = dict.fromkeys(f"{r.corruption} on {r.scenario}" for r in findings.results if r.unfit)
    if unfit:
        sentences.append(f"Left out, as the recording lacks what would be spoilt: {', '.join(unfit)}.")
    return sentences


def _factor(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.2f}"
