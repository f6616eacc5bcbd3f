"""What a result took and was made with: the stages of a run, announced on stderr and timed, their peak
memory read from the kernel; versions, code and processor."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

PROCESS = Path("/proc/self")
PACKAGES = ("numpy", "scipy", "numba", "pymunk", "opencv-python-headless", "gtsam", "matplotlib")
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
    with suppress(OSError):
        (PROCESS / "clear_refs").write_text("5")


def _peak_mb() -> float | None:
    status = PROCESS / "status"
    peak = re.search(r"VmHWM:\s+(\d+) kB", status.read_text()) if status.exists() else None
    return int(peak[1]) / 1024.0 if peak else None


def environment() -> dict[str, object]:
    """Versions, git hash and processor."""
    return {
        "slamstitch": _version("slamstitch"),
        "git": _git_hash(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git_hash() -> str | None:
    """Hash of the checkout, with ``-dirty`` when files differ from it; None outside of one."""
    root = Path(__file__).resolve().parents[1]
    if not (root / ".git").exists():  # installed, perhaps into somebody else's checkout
        return None
    command = ["git", "--no-optional-locks", "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        described = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return described.stdout.strip() or None


def _processor() -> str:
    cpus = Path("/proc/cpuinfo")
    model = re.search(r"^model name\s*:(.*)$", cpus.read_text() if cpus.exists() else "", re.MULTILINE)
    return model[1].strip() if model else platform.processor()
