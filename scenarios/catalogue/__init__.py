"""The scenarios, by name. Listing them imports no simulator.

A new one is a file with a function ``build(rng) -> Setup``, and an entry here: what the entry says is tested
on arrival.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

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

    def build(self, rng: np.random.Generator) -> Setup:
        """Draw the scenario's set-up: its character is fixed, furniture, hazards and exact route are not."""
        return import_module(f"{__name__}.{self.name}").build(rng)


_SCENARIOS = (
    Scenario(
        "hospital",
        "Corridors, rooms and a hall; sills, rubble and a fall make the matcher lose its place.",
        (39.0, 20.0),
        165.0,
    ),
    Scenario(
        "office_smoke",
        "A loop of 50 m through offices full of smoke: gaps without a match, and pieces that hardly overlap.",
        (65.0, 59.0),
        230.0,
    ),
    Scenario(
        "two_drives",
        "The same offices driven round twice, a blind gap and a fall between: two maps that overlap.",
        (65.0, 59.0),
        418.0,
    ),
    Scenario(
        "beehive",
        "Hexagonal rooms: walls in three directions, and rooms that look alike turned by 60 degrees.",
        (26.0, 24.0),
        108.0,
    ),
    Scenario(
        "corridor",
        "Between two bare parallel walls no scan tells how far the robot has come; encoders that slip do.",
        (66.0, 8.0),
        146.0,
    ),
    Scenario(
        "outdoor",
        "Trees, rocks and hedges on hilly ground: no straight walls, so the Hough transform finds no lines.",
        (52.5, 42.5),
        158.0,
    ),
    Scenario(
        "collapsed",
        "Rubble everywhere and steep slabs: the laser sees the floor as often as the walls.",
        (28.0, 22.0),
        117.0,
    ),
    Scenario(
        "twin_rooms",
        "Rows of identical rooms, furniture included: a stitch that fits need not be true.",
        (36.0, 11.0),
        115.0,
    ),
)

CATALOGUE: dict[str, Scenario] = {scenario.name: scenario for scenario in _SCENARIOS}
