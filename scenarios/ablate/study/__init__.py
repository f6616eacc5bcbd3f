"""The studies, one file each, found by their file's name.

A study is a module with a data class ``Options`` for the command line and a function ``run(options)``; the
first line of its docstring says what it answers.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from types import ModuleType

STUDIES: tuple[str, ...] = tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def study(name: str) -> ModuleType:
    """The module of a study."""
    return import_module(f"{__name__}.{name}")
