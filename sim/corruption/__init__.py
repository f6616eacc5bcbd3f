"""What can be done to a recording so that it is not what it says: kinds of corruption, at a severity each.

(The term is that of benchmarks of common corruptions, Hendrycks & Dietterich 2019.) A corruption takes a
recording, simulated or read, and returns a spoilt one. Truth, relations and the full-rate odometry stay.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.corruption import beams, person, readings, setup, surfaces, wheels
from sim.corruption.kind import LEVELS, Corruption, Kind, Severity
from slam.recording import Recording

FAMILIES = (wheels, readings, beams, surfaces, person, setup)
CORRUPTIONS: dict[str, Kind] = {kind.name: kind for family in FAMILIES for kind in family.KINDS}
"""Kinds by name."""


def corrupt(recording: Recording, corruptions: Sequence[Corruption], rng: np.random.Generator) -> Recording:
    """The recording after all ``corruptions``, one after the other, each with a stream of its own.

    Raises ``ValueError`` for a recording that lacks what is spoilt, or is too short for it.
    """
    for corruption, stream in zip(corruptions, rng.spawn(len(corruptions)), strict=True):
        recording = corruption.apply(recording, stream)
    return recording


__all__ = ["CORRUPTIONS", "LEVELS", "Corruption", "Kind", "Severity", "corrupt"]
