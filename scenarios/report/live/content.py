"""What the live map shows of a run, as plain JSON: the drive, the world and every method's answer."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from scenarios.evaluation.maps import map_at
from scenarios.evaluation.segmentation import step_deviations
from scenarios.evaluation.trajectory import aligned
from scenarios.report.live.encode import image, pack, pack_bits, rounded
from scenarios.report.live.scan_fit import fitting_beams, has_return
from scenarios.report.live.stitches import stitch_entries
from scenarios.report.method_attributes import colour_indices
from scenarios.report.trajectory_figures import covariance_of, segment_gaps, to_map_axes
from slam.mapping.occupancy import Grid
from slam.odometry.track import Track
from slam.recording import Recording
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    from sim.record import SimulatedRun

MAX_SCANS = 4000
"""Of a longer drive every second, third … scan is shown: the page shall open at once."""
RANGE_UNIT, ANGLE_UNIT, WALL_UNIT, POINT_UNIT = 0.005, 1e-4, 0.005, 0.01
"""What ranges [m], tilts [rad], true walls [m] and the points of submaps [m] are rounded to."""
UNKNOWN, FREE, WALL = 0, 128, 255
"""Shades of a map's image, which the page's script turns into the colours of its theme."""
FIELD_RESOLUTION = 0.1
"""Side of a pixel of smoke and uneven ground [m]."""


@dataclass(frozen=True)
class DownsampledDrive:
    """A recording and the ``rows (M,)`` of its scans that the page shows."""

    recording: Recording
    rows: np.ndarray

    @classmethod
    def of(cls, recording: Recording) -> DownsampledDrive:
        """All scans, or evenly spread ones of a long drive."""
        step = -(-len(recording) // MAX_SCANS)
        return cls(recording, np.arange(0, len(recording), step))

    def to_page_frame(self, poses: Array) -> Array:
        """``poses (N, 3)`` of a method in the page's frame: aligned to truth where there is one."""
        return poses if self.recording.truth is None else aligned(poses, self.recording.truth)


def live_content(
    recording: Recording, estimates: Sequence[Estimate], best: str | None, simulated: SimulatedRun | None
) -> dict[str, object]:
    """The run as plain JSON; ``best`` is the method that is shown first."""
    drive, config = DownsampledDrive.of(recording), AlignConfig()
    colours = colour_indices([estimate.method for estimate in estimates])
    return {
        "drive": drive_content(drive, simulated),
        "world": _world_content(simulated),
        "methods": [
            {
                **_method_content(drive, estimate),
                "colour": colour,
                "stitches": stitch_entries(estimate, recording.truth, config),
            }
            for estimate, colour in zip(estimates, colours, strict=True)
        ],
        "best": best,
    }


def script_safe(content: object) -> str:
    """JSON that cannot end the script element it stands in, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def drive_content(drive: DownsampledDrive, simulated: SimulatedRun | None) -> dict[str, object]:
    """The drive as recorded: stamps, beams, tilt and truth of the scans shown."""
    recording, rows = drive.recording, drive.rows
    ranges = np.where(has_return(recording), recording.ranges, np.nan)[rows]
    return {
        "scans": len(recording),
        "rows": pack(rows),
        "time": pack(recording.time[rows] - recording.time[0]),
        "angles": pack(recording.angles),
        "mount": [round(float(x), 6) for x in recording.laser.T_robot_laser],
        "ranges": pack(ranges, "u2", RANGE_UNIT),
        "truth": None if recording.truth is None else pack(recording.truth[rows]),
        "tilt": _tilt(drive, simulated),
        "height": None if simulated is None else simulated.setup.scanner.height,
    }


def map_image(grid: Grid) -> dict[str, object]:
    """A map: which cells are walls and which are free."""
    shades = np.where(grid.occupied, WALL, np.where(grid.free, FREE, UNKNOWN)).astype(np.uint8)
    return image(shades, grid.origin, grid.resolution)


def _tilt(drive: DownsampledDrive, simulated: SimulatedRun | None) -> dict[str, object] | None:
    """Roll and pitch, the true ones where a simulator knows them."""
    tilt = drive.recording.attitude if simulated is None else simulated.tilt
    if tilt is None:
        return None
    source = "as the inertial sensor says" if simulated is None else "the true one"
    return {"source": source, "angles": pack(tilt[drive.rows], "i2", ANGLE_UNIT)}


def _world_content(simulated: SimulatedRun | None) -> dict[str, object]:
    """The true walls at the laser's height, smoke and uneven ground; None for what is unknown or absent."""
    if simulated is None:
        return {"walls": None, "smoke": None, "terrain": None}
    world = simulated.setup.world
    terrain, smoke = world.terrain, world.smoke
    return {
        "walls": pack(simulated.walls, "i2", WALL_UNIT) if len(simulated.walls) else None,
        "smoke": None if smoke is None else _field(smoke.extinction, smoke.origin, smoke.resolution),
        "terrain": _field(np.abs(terrain.heights), terrain.origin, terrain.resolution),
    }


def _field(values: Array, origin: tuple[float, float], resolution: float) -> dict[str, object] | None:
    """A field over nodes, brightest where it is highest; None where it is zero everywhere."""
    top = float(values.max(initial=0.0))
    if top <= 0.0:
        return None
    step = max(1, round(FIELD_RESOLUTION / resolution))
    corner = np.asarray(origin) - 0.5 * resolution * step
    shades = np.rint(255.0 * np.sqrt(np.clip(values[::step, ::step] / top, 0.0, 1.0))).astype(np.uint8)
    return {**image(shades, corner, resolution * step), "top": top}


def _method_content(drive: DownsampledDrive, estimate: Estimate) -> dict[str, object]:
    """A method's answer but its stitches: path, map, submaps, and what its front end says of every scan."""
    recording, rows = drive.recording, drive.rows
    poses = drive.to_page_frame(estimate.poses)
    return {
        "name": estimate.method,
        "poses": pack(poses[rows]),
        "map": _map(recording, poses),
        "fits": pack_bits(fitting_beams(recording, estimate.poses, rows)),
        "track": None if estimate.track is None else _track(estimate.track, recording, rows),
        "spread": _covariances(estimate, poses, rows),
        "submaps": _submaps(estimate, poses),
        "cuts": [[int(first), int(last)] for first, last in segment_gaps(estimate.submaps)],
    }


def _map(recording: Recording, poses: Array) -> dict[str, object] | None:
    """The map, None where the method lost itself so far that no image holds it."""
    try:
        return map_image(map_at(recording, poses))
    except ValueError:
        return None


def _track(track: Track, recording: Recording, rows: np.ndarray) -> dict[str, object]:
    """Verdict, matches and confidence of every scan, and the true error of its step [m]."""
    deviations = step_deviations(track, recording.truth)[rows]
    error = None if recording.truth is None else pack(np.hypot(deviations[:, 0], deviations[:, 1]))
    return {
        "verdict": pack(track.verdict[rows], "u1"),
        "matches": pack(track.matches[rows], "u2"),
        "measures": {name: pack(column[rows]) for name, column in track.confidence.items()},
        "error": error,
    }


def _covariances(estimate: Estimate, poses: Array, rows: np.ndarray) -> dict[str, object] | None:
    """Covariance xx, xy, yy [m²] of every position in the page's axes, and what it is of."""
    stated = covariance_of(estimate)
    if stated is None:
        return None
    P = to_map_axes(poses[rows], stated[0][rows])
    what = {"pose": "of the pose", "step": "of the step from the scan it was matched to"}[stated[1]]
    return {"what": what, "values": pack(np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], -1))}


def _submaps(estimate: Estimate, poses: Array) -> list[dict[str, object]]:
    """Each submap's scans, place, and wall points in its own frame."""
    return [
        {
            "start": submap.start,
            "stop": submap.stop,
            "pose": rounded(poses[submap.start]),
            "points": pack(submap.grid.occupied_points(), "i2", POINT_UNIT),
        }
        for submap in estimate.submaps
    ]
