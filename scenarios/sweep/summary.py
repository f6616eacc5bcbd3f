"""What a sweep cost and what failed, told at its end."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.sweep.outcome import Outcome
    from scenarios.sweep.swept import Swept
    from scenarios.sweep.trial import Trial


def finish(swept: Swept, store: Path | None) -> None:
    """Tell cost and failures on stderr. Exits with 1 when a trial failed."""
    for line in told(swept, store):
        print(line, file=sys.stderr)
    if swept.failed:
        sys.exit(1)


def told(swept: Swept, store: Path | None) -> list[str]:
    """How many trials ran, what they cost, how many failed and where to look."""
    before = f", {swept.reused} were answered before" if swept.reused else ""
    lines = [f"{swept.ran} trials ran{before}", *costs(swept.trials, swept.outcomes)]
    if swept.failed:
        trial, failure = swept.failed[0]
        lines.append(
            f"{len(swept.failed)} of {len(swept.trials)} trials failed, "
            f"the first: {trial.name}: {failure.line}"
        )
        if store is not None:
            lines.append(f"python -m scenarios.sweep {store} shows them; the same command tries them again")
    return lines


def costs(trials: Sequence[Trial], outcomes: Sequence[Outcome]) -> list[str]:
    """Mean wall time of a trial by method, and of preparing a drive."""
    by_method: dict[str, list[float]] = {}
    drives: dict[tuple[str, int], float] = {}
    for trial, outcome in zip(trials, outcomes, strict=True):
        by_method.setdefault(trial.method, []).append(outcome.seconds)
        drives[trial.drive] = outcome.preparing
    said = [f"{name} {fmean(seconds):.3g}" for name, seconds in by_method.items()]
    if any(drives.values()):
        said.append(f"preparing a drive {fmean(drives.values()):.3g}")
    return [f"seconds per trial: {', '.join(said)}"] if said else []
