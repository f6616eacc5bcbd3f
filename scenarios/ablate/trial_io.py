"""What trials of the studies draw from, and how they hand back arrays."""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

Purpose = Literal["sessions", "pairs", "priors", "bends"]
NUMBERS: dict[Purpose, int] = {"sessions": 2, "pairs": 3, "priors": 4, "bends": 5}
"""What keeps the streams of a scenario and seed apart; without a number it is the simulator's own."""


def stream(seed: int, scenario: str, purpose: Purpose, *index: int) -> np.random.Generator:
    """The generator of a scenario's drive for one ``purpose``; ``index`` counts streams of that purpose."""
    return np.random.default_rng([seed, name_hash(scenario), NUMBERS[purpose], *index])


def name_hash(name: str) -> int:
    """A number for a name that is the same on every machine (CRC-32)."""
    return zlib.crc32(name.encode())


def pack(arrays: Mapping[str, Any]) -> bytes:
    """Arrays as the payload of an answer, an .npz file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def unpack(payload: bytes) -> dict[str, Any]:
    """The arrays that were packed."""
    with np.load(io.BytesIO(payload), allow_pickle=False) as stored:
        return dict(stored)
