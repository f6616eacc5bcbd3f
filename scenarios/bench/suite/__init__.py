"""The benches, one file each: a docstring that says what it measures, and ``run(stages, options)``."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any

BENCHES: tuple[str, ...] = tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def bench(name: str) -> Any:
    """The function that runs a bench."""
    return import_module(f"{__name__}.{name}").run
