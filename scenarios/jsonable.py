"""Values as strict JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np


def dump(path: Path, content: object) -> None:
    """Write ``content`` as JSON."""
    path.write_text(
        json.dumps(jsonable(content, words=True), indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )


def document(**content: object) -> str:
    """``content`` as a command prints it: JSON with a schema's number, null for what is not finite."""
    return json.dumps(jsonable({"schema": 1, **content}), indent=2)


def jsonable(value: Any, words: bool = False) -> Any:
    """A value as JSON has it: data classes as objects, arrays as lists.

    What is not finite becomes null, or with ``words`` "nan", "inf" or "-inf", which `float` reads back.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return jsonable(asdict(value), words)
    if isinstance(value, Mapping):
        return {str(key): jsonable(item, words) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return jsonable(value.tolist(), words)
    if isinstance(value, list | tuple):
        return [jsonable(item, words) for item in value]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value) if words else None
    return value
