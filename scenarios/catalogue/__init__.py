"""The scenarios, by name. Listing them imports no simulator.

A new one is a file with a function ``build(rng) -> Setup`` and an entry in ``catalogue.yaml``: what the entry
says is tested on arrival.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    import numpy as np

    from sim.record import Setup


@dataclass(frozen=True)
class Scenario:
    """A world, a route and its hazards, built by the function ``build(rng)`` of the file of its name."""

    name: str
    summary: str
    """Why it exists, in one sentence."""
    size_m: tuple[float, float]
    """Of the ground it covers, along x and y [m]."""
    drive_m: float
    """Length of a drive, about [m]."""
    setup: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """What its set-up has instead of the defaults."""

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw the scenario's set-up: its character is fixed, furniture, hazards and exact route are not."""
        return configured(import_module(f"{__name__}.{self.name}").build(rng), self.setup)


def configured(config: Any, settings: Mapping[str, Any]) -> Any:
    """A data class with other values in some fields, of data classes within it too; angles in degrees where
    the key says ``_deg``."""
    values = {}
    for key, value in settings.items():
        name, degrees = key.removesuffix("_deg"), key.endswith("_deg")
        if isinstance(value, Mapping):
            value = configured(getattr(config, name), value)
        values[name] = radians(value) if degrees else tuple(value) if isinstance(value, list) else value
    return replace(config, **values)


CATALOGUE: dict[str, Scenario] = {
    name: Scenario(name, **entry | {"size_m": tuple(entry["size_m"])})
    for name, entry in yaml.safe_load(Path(__file__).with_name("catalogue.yaml").read_text("utf-8")).items()
}
