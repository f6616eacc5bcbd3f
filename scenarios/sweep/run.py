"""A sweep: every trial that has no answer yet is run, and kept; the answers come in the trials' order."""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import TypeAlias

from scenarios.sweep.executors import SchedulerLostError, executor_for
from scenarios.sweep.progress import Progress, showing
from scenarios.sweep.scheduler import Numbered, TrialScheduler
from scenarios.sweep.store import Store, opened
from scenarios.sweep.trial import Answer, Failure, Outcome, Prepare, RunTrial, Trial
from slam.cli import InputError

OnResult: TypeAlias = Callable[[Trial, Answer | Failure], None]


@dataclass(frozen=True)
class SweepResult:
    """Trials in their order, how each ended, and how many ran now or were answered before."""

    trials: tuple[Trial, ...]
    outcomes: tuple[Outcome, ...]
    ran: int
    reused: int

    @property
    def answers(self) -> list[Answer | Failure]:
        """What each trial came to."""
        return [outcome.result for outcome in self.outcomes]

    @property
    def answered(self) -> list[tuple[Trial, Answer]]:
        """Trials that have an answer, with it."""
        return [(t, r) for t, r in zip(self.trials, self.answers, strict=True) if isinstance(r, Answer)]

    @property
    def failed(self) -> list[tuple[Trial, Failure]]:
        """Trials that have none, with the reason."""
        return [(t, r) for t, r in zip(self.trials, self.answers, strict=True) if isinstance(r, Failure)]


def sweep(
    trials: Iterable[Trial],
    run_trial: RunTrial,
    store: Path | None,
    *,
    prepare: Prepare | None = None,
    each: OnResult | None = None,
    scheduler: str | None = None,
    workers: int = 0,
    fresh: bool = False,
) -> SweepResult:
    """Run all trials, but for those that the ``store`` holds answers to; None keeps nothing.

    ``run_trial(trial, material)`` and ``prepare(scenario, seed) -> material`` are functions that can be
    pickled, as can what they return; the second is called once for trials of one drive that follow each
    other. ``trials`` is drawn from as workers become free, and ``each(trial, result)`` is called in the order
    of trials as they are known. Workers are those of the ``scheduler``, or so many processes here, 0 for one
    per core; 1 is this process.

    Raises `InputError` where the store or the scheduler cannot be used, or is lost; what is done stays kept.
    """
    drawn = iter(trials)
    first = next(drawn, None)
    if first is None:
        return SweepResult((), (), 0, 0)
    log = _Log(each)
    with opened(store, fresh) as held, showing(first.study, trials) as progress:
        left = _unanswered(chain([first], drawn), held, log, progress)
        begun = next(left, None)
        if begun is not None:  # a finished sweep needs no cluster
            with executor_for(scheduler, workers, progress.say) as executor:
                try:
                    jobs = TrialScheduler(chain([begun], left), executor, run_trial, prepare)
                    for (number, trial), outcome in jobs.outcomes():
                        held.keep(trial, outcome)
                        progress.finished(outcome.failed)
                        log.put(number, outcome)
                except SchedulerLostError as error:
                    raise InputError(f"{error}; {held.kept}") from error
    outcomes = tuple(log.outcomes[number] for number in range(len(log.trials)))
    return SweepResult(tuple(log.trials), outcomes, progress.ran, progress.reused)


class _Log:
    """Outcomes by the trials' numbers; ``each`` is called for a trial as soon as all before it are known."""

    def __init__(self, each: OnResult | None) -> None:
        self.each = each
        self.trials: list[Trial] = []
        self.outcomes: dict[int, Outcome] = {}
        self.reported = 0

    def put(self, number: int, outcome: Outcome) -> None:
        """Note how a trial ended."""
        self.outcomes[number] = outcome
        while self.reported in self.outcomes:
            if self.each is not None:
                self.each(self.trials[self.reported], self.outcomes[self.reported].result)
            self.reported += 1


def _unanswered(trials: Iterable[Trial], store: Store, log: _Log, progress: Progress) -> Iterator[Numbered]:
    """Trials that the store has no answer to, numbered; the others are in the log."""
    for number, trial in enumerate(trials):
        log.trials.append(trial)
        outcome = store.find(trial)
        if outcome is None:
            yield number, trial
        else:
            progress.reused += 1
            log.put(number, outcome)


def check(scheduler: str | None, workers: int, out: Path) -> None:
    """The options that every study shares, before anything is done. Raises `InputError`."""
    if workers < 0:
        raise InputError(f"expected --workers >= 0, got {workers}")
    if scheduler is not None:
        if workers:
            raise InputError("--workers is for this machine alone: expected either it or --scheduler")
        if not re.fullmatch(r"(tcp|tls|wss?|ucx)://[^/\s]+:\d{1,5}", scheduler):
            raise InputError(f"--scheduler {scheduler!r}: expected an address like tcp://host:8786")
    if out.is_file():
        raise InputError(f"--out {out}: expected a folder, found a file")


def write_results(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Rows as CSV, whole or not at all. Raises `InputError` where the disk will not have it."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("w", newline="") as file:
            table = csv.DictWriter(file, columns, restval="")
            table.writeheader()
            table.writerows(rows)
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error


def finish(result: SweepResult, store: Path | None) -> None:
    """Tell cost and failures on stderr. Exits with 1 when a trial failed."""
    for line in summary_lines(result, store):
        print(line, file=sys.stderr)
    if result.failed:
        sys.exit(1)


def summary_lines(result: SweepResult, store: Path | None) -> list[str]:
    """How many trials ran, mean wall time by method and of preparing a drive, how many failed and where to
    look."""
    by_method: dict[str, list[float]] = {}
    for trial, outcome in zip(result.trials, result.outcomes, strict=True):
        by_method.setdefault(trial.method, []).append(outcome.seconds)
    drives = {t.drive: outcome.preparing for t, outcome in zip(result.trials, result.outcomes, strict=True)}
    costs = [f"{name} {fmean(seconds):.3g}" for name, seconds in by_method.items()]
    if any(drives.values()):
        costs.append(f"preparing a drive {fmean(drives.values()):.3g}")
    before = f", {result.reused} were answered before" if result.reused else ""
    lines = [f"{result.ran} trials ran{before}"]
    if costs:
        lines.append(f"seconds per trial: {', '.join(costs)}")
    if result.failed:
        trial, failure = result.failed[0]
        count = f"{len(result.failed)} of {len(result.trials)} trials failed"
        lines.append(f"{count}, the first: {trial.name}: {failure.line}")
        if store is not None:
            lines.append(f"python -m scenarios.sweep {store} shows them; the same command tries them again")
    return lines
