"""The drive as recorded: when, what the laser saw, how the robot was tilted, where it truly was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.live.packed import packed
from scenarios.report.live.shown import Shown

if TYPE_CHECKING:
    from sim.record import SimulatedRun

RANGE_UNIT, ANGLE_UNIT = 0.005, 1e-4
"""What ranges [m] and tilts [rad] are rounded to."""


def drive(shown: Shown, simulated: SimulatedRun | None) -> dict[str, object]:
    """Stamps, beams, tilt and truth of the scans shown."""
    recording, rows = shown.recording, shown.rows
    laser = recording.laser
    seen = (recording.ranges >= laser.range_min) & (recording.ranges < laser.range_max)
    ranges = np.where(seen, recording.ranges, np.nan)[rows]
    return {
        "scans": len(recording),
        "rows": packed(rows),
        "time": packed(recording.time[rows] - recording.time[0]),
        "angles": packed(recording.angles),
        "mount": [round(float(x), 6) for x in laser.T_robot_laser],
        "ranges": packed(ranges, "u2", RANGE_UNIT),
        "truth": None if recording.truth is None else packed(recording.truth[rows]),
        "tilt": _tilt(shown, simulated),
        "height": None if simulated is None else simulated.setup.scanner.height,
    }


def _tilt(shown: Shown, simulated: SimulatedRun | None) -> dict[str, object] | None:
    """Roll and pitch, the true ones where a simulator knows them."""
    tilt = shown.recording.attitude if simulated is None else simulated.tilt
    if tilt is None:
        return None
    source = "as the inertial sensor says" if simulated is None else "the true one"
    return {"source": source, "angles": packed(tilt[shown.rows], "i2", ANGLE_UNIT)}
