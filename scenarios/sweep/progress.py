"""How far a sweep is, on stderr: a live line on a terminal, a few plain ones elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

QUIET_S = 30.0
"""Least seconds between two plain lines."""


class Progress:
    """Counts trials: so many of ``total`` (None: nobody knows) were answered before, ran, and failed."""

    def __init__(
        self, total: int | None, show: Callable[[Progress], None], say: Callable[[str], None]
    ) -> None:
        self.total = total
        self.reused = self.ran = self.failed = 0
        self.started = time.monotonic()
        self.show = show
        self.say = say

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
        seconds = time.monotonic() - self.started
        if self.ran:
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
def showing(name: str, total: int | None) -> Iterator[Progress]:
    """Progress of a study by name."""
    if not sys.stderr.isatty():
        yield _plain(name, total)
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


def _plain(name: str, total: int | None) -> Progress:
    """A line every now and then, for logs."""
    last = time.monotonic()

    def show(progress: Progress) -> None:
        nonlocal last
        if time.monotonic() - last >= QUIET_S:
            last = time.monotonic()
            say(progress.words())

    def say(words: str) -> None:
        print(f"{name}: {words}", file=sys.stderr, flush=True)

    return Progress(total, show, say)
