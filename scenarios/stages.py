"""The stages of a run: announced on stderr, timed, their peak memory read from the kernel."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

PROCESS = Path("/proc/self")
T = TypeVar("T")


@dataclass(frozen=True)
class Cost:
    """Wall time [s] and peak resident memory [MB] of a stage; None where the system does not measure it."""

    wall_s: float
    peak_mb: float | None


@dataclass
class Stages:
    """What has been done so far, by name."""

    console: Console
    costs: dict[str, Cost] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage, and note its cost when it ends well."""
        _reset_peak()
        started = time.perf_counter()
        with self.console.status(f"{name} …"):
            yield
        self.costs[name] = Cost(time.perf_counter() - started, _peak_mb())
        self.console.print(f"{name:<12} {self.costs[name].wall_s:6.1f} s", style="dim", highlight=False)


def timed(call: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """What a call returns, and its processor time [s]."""
    started = time.process_time()
    result = call(*arguments)
    return result, time.process_time() - started


def _reset_peak() -> None:
    """Reset the kernel's peak of resident memory; where it cannot be, the peak is that of the process."""
    reset = PROCESS / "clear_refs"
    if reset.exists():
        try:
            reset.write_text("5")
        except OSError:
            return


def _peak_mb() -> float | None:
    status = PROCESS / "status"
    if not status.exists():
        return None
    peak = re.search(r"VmHWM:\s+(\d+) kB", status.read_text())
    return int(peak[1]) / 1024.0 if peak else None
