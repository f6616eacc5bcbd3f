"""Random streams that depend on a seed and on names, not on the order of the work."""

from __future__ import annotations

import zlib
from typing import Literal

import numpy as np

Purpose = Literal["sessions", "pairs", "priors"]
NUMBERS: dict[Purpose, int] = {"sessions": 2, "pairs": 3, "priors": 4}
"""What keeps the streams of a scenario and seed apart; without a number it is the simulator's own."""


def stream(seed: int, scenario: str, purpose: Purpose, *index: int) -> np.random.Generator:
    """The generator of a scenario's drive for one ``purpose``; ``index`` counts streams of that purpose."""
    return np.random.default_rng([seed, name_hash(scenario), NUMBERS[purpose], *index])


def name_hash(name: str) -> int:
    """A number for a name that is the same on every machine (CRC-32)."""
    return zlib.crc32(name.encode())
