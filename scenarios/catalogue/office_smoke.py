"""Experiment 2 of Formsma's thesis: once round a large office building, with smoke everywhere.

Clouds of smoke scatter the beams: half of those scattered come back from where nothing is, and for some
metres the matcher finds nothing at all, in runs of several steps. Few places are seen twice, so that the
pieces hardly overlap: the loop of 50 m across closes only where it began. The thesis's stitching made this
map worse than it was.
"""

from __future__ import annotations

import numpy as np

from scenarios.catalogue import office
from scenarios.catalogue.building import spread, start
from sim.record import Setup

CLOUDS, RADIUS, EXTINCTION = 6, (1.5, 4.0), (3.0, 10.0)
"""Number, radius [m] and extinction coefficient [1/m] of the clouds on the route."""


def build(rng: np.random.Generator) -> Setup:
    """One office building: doors, furniture, clouds and the exact route drawn from ``rng``."""
    begin = np.array([office.MIDDLE, rng.uniform(10.0, 14.0)])
    again = office.round_trip(rng)[:4]
    route = np.array([begin, [office.MIDDLE, 2.5], *office.round_trip(rng), *again])
    clouds = [(place, rng.uniform(*RADIUS), rng.uniform(*EXTINCTION)) for place in spread(route, CLOUDS, rng)]
    return Setup(office.world(route, clouds, rng), start(route), route)
