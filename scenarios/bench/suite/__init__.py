"""The benches, one file each, found by their file's name.

A bench is a module with a function ``run(stages, options) -> BenchmarkResult``; the first line of its
docstring says what it measures.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any

BENCHES: tuple[str, ...] = tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def bench(name: str) -> Any:
    """The function that runs a bench."""
    return import_module(f"{__name__}.{name}").run
