"""The scenarios, by name. Listing them imports no simulator: each is built by a function named here."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from sim.record import Setup


@dataclass(frozen=True)
class Scenario:
    """A world, a route and its hazards: ``summary`` says why it exists, ``builder`` is module:function."""

    name: str
    summary: str
    builder: str

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw the scenario's set-up: its character is fixed, furniture, hazards and exact route are not."""
        module, function = self.builder.split(":")
        return getattr(import_module(module), function)(rng)


_SCENARIOS = (
    Scenario(
        "hospital",
        "Corridors, rooms and a hall; sills, rubble and a fall make the matcher lose its place.",
        "scenarios.catalogue.hospital:build",
    ),
)

CATALOGUE: dict[str, Scenario] = {scenario.name: scenario for scenario in _SCENARIOS}
