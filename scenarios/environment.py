"""What a result was made with: versions, code, processor, and the cost of each stage."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from scenarios.stages import Cost

PACKAGES = ("numpy", "scipy", "numba", "pymunk", "opencv-python-headless", "gtsam", "matplotlib")


def environment(costs: Mapping[str, Cost]) -> dict[str, object]:
    """Versions, git hash, processor and the stages' costs, ready for JSON."""
    return {
        "slamstitch": _version("slamstitch"),
        "git": _git_hash(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "stages": {name: asdict(cost) for name, cost in costs.items()},
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git_hash() -> str | None:
    """Hash of the checkout, with ``-dirty`` when files differ from it; None outside of one."""
    here = Path(__file__).resolve().parent
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=here, capture_output=True, text=True, check=True, timeout=10,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()
