"""Robots and lasers other than the Kenaf with its Hokuyo, which is what a set-up has if nothing is said."""

from __future__ import annotations

import numpy as np

from sim.laser import Scanner
from sim.robot import RobotConfig

PIONEER = RobotConfig(length=0.52, width=0.44, height=0.5, mass=14.0)
"""The P2AT of the older USARSim logs."""
SICK = Scanner(beams=181, field_of_view=np.pi, range_min=0.1, range_max=20.0, mount=(0.1, 0.0, 0.0))
"""A laser of 1 degree steps that reaches 20 m."""
