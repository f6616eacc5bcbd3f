"""A sweep: every trial that has no answer yet is run, and kept; the answers come in the trials' order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sized
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from scenarios.sweep.attempt import Answering, Prepare
from scenarios.sweep.cluster import SchedulerLostError, pool
from scenarios.sweep.course import Course, Numbered
from scenarios.sweep.ledger import Each, Ledger
from scenarios.sweep.outcome import Outcome
from scenarios.sweep.progress import Progress, showing
from scenarios.sweep.store import Store, opened
from scenarios.sweep.trial import Answer, Failure, Trial
from slam.cli import InputError


@dataclass(frozen=True)
class Swept:
    """Trials in their order, what each came to, and how many ran now or were answered before."""

    trials: tuple[Trial, ...]
    outcomes: tuple[Outcome, ...]
    ran: int
    reused: int

    @property
    def answers(self) -> list[Answer | Failure]:
        """What each trial came to."""
        return [outcome.read() for outcome in self.outcomes]

    @property
    def answered(self) -> list[tuple[Trial, Answer]]:
        """Trials that have an answer, with it."""
        both = zip(self.trials, self.answers, strict=True)
        return [(trial, found) for trial, found in both if isinstance(found, Answer)]

    @property
    def failed(self) -> list[tuple[Trial, Failure]]:
        """Trials that have none, with the reason."""
        both = zip(self.trials, self.answers, strict=True)
        return [(trial, found) for trial, found in both if isinstance(found, Failure)]


def sweep(
    trials: Iterable[Trial],
    answer: Answering,
    store: Path | None,
    *,
    prepare: Prepare | None = None,
    each: Each | None = None,
    scheduler: str | None = None,
    workers: int = 0,
    fresh: bool = False,
) -> Swept:
    """Answer all trials, but for those that the ``store`` holds answers to; None keeps nothing.

    ``answer(trial, material)`` and ``prepare(scenario, seed) -> material`` are functions that can be pickled;
    the second is called once for trials of one drive that follow each other. ``trials`` is drawn from as
    workers become free, and ``each(trial, answer)`` is called in the order of trials as they are known.
    Workers are those of the ``scheduler``, or so many processes here, 0 for one per core; 1 is this process.

    Raises `InputError` where the store or the scheduler cannot be used, or is lost; what is done stays kept.
    """
    asked = iter(trials)
    first = next(asked, None)
    if first is None:
        return Swept((), (), 0, 0)
    ledger = Ledger(each)
    total = len(trials) if isinstance(trials, Sized) else None
    with opened(store, fresh) as held, showing(first.study, total) as progress:
        left = unanswered(chain([first], asked), held, ledger, progress)
        begun = next(left, None)
        if begun is not None:  # a finished sweep needs no cluster
            with pool(scheduler, workers, progress.say) as workers_here:
                course = Course(chain([begun], left), workers_here, answer, prepare)
                run(course, held, ledger, progress)
    outcomes = tuple(one for one in ledger.outcomes if one is not None)
    return Swept(tuple(ledger.trials), outcomes, progress.ran, progress.reused)


def unanswered(
    trials: Iterable[Trial], store: Store, ledger: Ledger, progress: Progress
) -> Iterator[Numbered]:
    """Trials that the store has no answer to, numbered; the others are in the ledger."""
    for trial in trials:
        number = ledger.enter(trial)
        found = store.find(trial)
        if found is None:
            yield number, trial
        else:
            progress.found()
            ledger.put(number, found)


def run(course: Course, store: Store, ledger: Ledger, progress: Progress) -> None:
    """Keep every outcome as it comes. Raises `InputError` when the scheduler is lost on the way."""
    try:
        for (number, trial), outcome in course.outcomes():
            store.keep(trial, outcome)
            progress.finished(outcome.traceback is not None)
            ledger.put(number, outcome)
    except SchedulerLostError as error:
        raise InputError(f"{error}; {store.kept}") from error
