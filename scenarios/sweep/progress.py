"""How far a sweep is, on stderr: a live line on a terminal, a few plain ones elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager

QUIET_S = 30.0
"""Least seconds between two plain lines."""


class Progress:
    """Counts trials: so many of ``total`` (None: nobody knows) were answered before, ran, and failed.

    ``show`` is called with it as a trial ends, ``say`` with whatever else is to be told.
    """

    def __init__(
        self, total: int | None, show: Callable[[Progress], None], say: Callable[[str], None]
    ) -> None:
        self.total, self.show, self.say = total, show, say
        self.reused = self.ran = self.failed = 0
        self.started = time.monotonic()

    @property
    def done(self) -> int:
        """Trials that have ended, now or before."""
        return self.reused + self.ran

    def finished(self, failed: bool) -> None:
        """A trial has ended."""
        self.ran += 1
        self.failed += failed
        self.show(self)

    def words(self) -> str:
        """Trials done, rate and time left, in one line."""
        of = "" if self.total is None else f" of {self.total}"
        parts = [f"{self.done}{of} trials"]
        if self.failed:
            parts.append(f"{self.failed} failed")
        if self.ran:
            seconds = time.monotonic() - self.started
            rate = self.ran / max(seconds, 1e-3)
            parts.append(f"{rate:.1f}/s" if rate >= 1.0 else f"{60.0 * rate:.1f}/min")
            if self.total is not None:
                parts.append(f"{_span((self.total - self.done) * seconds / self.ran)} left")
        return ", ".join(parts)


def _span(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


@contextmanager
def showing(name: str, trials: Iterable[object]) -> Iterator[Progress]:
    """Progress of a study by name, towards as many trials as are known to come."""
    total = len(trials) if isinstance(trials, Sized) else None
    if not sys.stderr.isatty():
        last = time.monotonic()

        def print_now_and_then(progress: Progress) -> None:
            nonlocal last
            if time.monotonic() - last >= QUIET_S:
                last = time.monotonic()
                progress.say(progress.words())

        say = lambda words: print(f"{name}: {words}", file=sys.stderr, flush=True)  # noqa: E731
        yield Progress(total, print_now_and_then, say)
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    bars = Bars(TextColumn(name), BarColumn(), TextColumn("{task.description}"), console=Console(stderr=True))
    with bars:
        bar = bars.add_task("", total=total)

        def show(progress: Progress) -> None:
            bars.update(bar, completed=progress.done, description=progress.words())

        yield Progress(total, show, lambda words: bars.print(f"{name}: {words}"))
