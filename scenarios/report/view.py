"""A run in Rerun: scans, paths, submaps and loop closures over time, in metres, z up."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.evaluation.segmentation import false_stitches
from scenarios.evaluation.trajectory import aligned
from scenarios.report.live import has_return
from scenarios.report.method_attributes import colour_indices, merges_in_sequence
from scenarios.report.stitches import state_of
from scenarios.run_folder.read import read_run
from slam import se2
from slam.cli import InputError
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

if find_spec("rerun") is not None:
    import rerun as rr

MISSING = "Rerun is not installed: pip install -e '.[view]' (or pip install rerun-sdk) brings it"
PALETTE = ("0072b2", "c98a00", "d55e00", "b5528d", "2f9fd8", "009e73", "7a6ff0", "6d7a00")
"""Colours of methods and submaps: those of the page."""
STATES = {"accepted": "00805f", "false": "c2300a", "rejected": "7b8490", "refused": "a0a8b2"}
"""Colours of stitches by their state."""


def check() -> None:
    """Raises `InputError` with how to install it where Rerun is missing."""
    if find_spec("rerun") is None:
        raise InputError(MISSING)


def run(folders: Sequence[Path], out: Path | None) -> str:
    """Show a run in Rerun's viewer, or write it to the file ``out``; returns the path of what is shown or
    written. Raises `InputError`."""
    check()
    if len(folders) != 1:
        raise InputError(f"view: expected one run, got {len(folders)}")
    recording, estimates, _ = read_run(folders[0])
    stream = rr.RecordingStream("slamstitch", recording_id=f"{folders[0].resolve().name}")
    if out is None:
        stream.spawn()
    else:
        out.parent.mkdir(parents=True, exist_ok=True)
        stream.save(out)
    log(stream, recording, estimates)
    stream.flush()
    return str(folders[0] if out is None else out)


def log(stream: rr.RecordingStream, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """Everything about a run, over the timelines ``scan`` and ``time``."""
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if recording.truth is not None:
        stream.log("truth/path", rr.LineStrips3D([_flat(recording.truth[:, :2])]), static=True)
    indices = colour_indices([estimate.method for estimate in estimates])
    for estimate, index in zip(estimates, indices, strict=True):
        entity, colour = rr.escape_entity_path_part(estimate.method), _rgb(PALETTE[index])
        poses = aligned(estimate.poses, recording.truth)
        path = rr.LineStrips3D([_flat(poses[:, :2])], colors=colour)
        stream.log(f"{entity}/path", path, static=True)
        _log_scans(stream, entity, recording, estimate, poses, colour)
        _log_pieces(stream, entity, recording, estimate, poses)


def _log_scans(
    stream: rr.RecordingStream, entity: str, recording: Recording, estimate: Estimate, poses: Array,
    colour: tuple[int, ...],
) -> None:  # fmt: skip
    """The robot at every scan, in its frame what it saw, and every measure of the front end, which is
    infinite where a match failed."""
    times: list[Any] = [
        rr.TimeColumn("scan", sequence=np.arange(len(recording))),
        rr.TimeColumn("time", duration=recording.time - recording.time[0]),
    ]
    half = poses[:, 2] / 2.0
    turns = np.stack([np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)], -1)
    places = rr.Transform3D.columns(translation=_flat(poses[:, :2]), quaternion=turns)
    stream.send_columns(f"{entity}/robot", times, places)
    body = rr.Boxes3D(half_sizes=[0.27, 0.2, 0.1], colors=colour)
    stream.log(f"{entity}/robot/body", body, static=True)
    seen = has_return(recording)
    r = np.where(seen, recording.ranges, 0.0)
    ends = np.stack([r * np.cos(recording.angles), r * np.sin(recording.angles)], -1)
    points = se2.transform(recording.laser.T_robot_laser, ends)[seen]
    clouds = rr.Points3D.columns(positions=_flat(points)).partition(seen.sum(axis=1))
    stream.send_columns(f"{entity}/robot/scan", times, clouds)
    if estimate.track is not None:
        for name, column in {"matches": estimate.track.matches, **estimate.track.confidence}.items():
            values = rr.Scalars.columns(scalars=np.asarray(column, dtype=np.float64))
            stream.send_columns(f"{entity}/confidence/{name}", times, values)


def _log_pieces(
    stream: rr.RecordingStream, entity: str, recording: Recording, estimate: Estimate, poses: Array
) -> None:
    """Each submap where the map has it in the end, from its last scan on; each stitch from the last scan of
    the later submap on, coloured by what became of it."""
    for k, submap in enumerate(estimate.submaps):
        _at(stream, recording, submap.stop - 1)
        points = se2.transform(poses[submap.start], submap.grid.occupied_points())
        cloud = rr.Points3D(_flat(points), colors=_rgb(PALETTE[k % len(PALETTE)]), radii=0.03)
        stream.log(f"{entity}/submaps/{k}", cloud)
    false = false_stitches(estimate, recording.truth)
    for k, stitch in enumerate(estimate.stitches):
        a = stitch.b - 1 if merges_in_sequence(estimate.method) else stitch.a
        ends = poses[[estimate.submaps[a].start, estimate.submaps[stitch.b].start], :2]
        state = state_of(stitch, k in false)
        _at(stream, recording, estimate.submaps[stitch.b].stop - 1)
        line = rr.LineStrips3D([_flat(ends)], colors=_rgb(STATES[state]), labels=state, show_labels=False)
        stream.log(f"{entity}/stitches/{state}/{stitch.a}-{stitch.b}", line)


def _at(stream: rr.RecordingStream, recording: Recording, scan: int) -> None:
    stream.set_time("scan", sequence=scan)
    stream.set_time("time", duration=float(recording.time[scan] - recording.time[0]))


def _flat(points: Array) -> Array:
    """Points ``(n, 2)`` on the floor of three dimensions."""
    return np.column_stack([points, np.zeros(len(points))])


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(colour))
