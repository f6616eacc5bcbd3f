"""Writes what a run found into its folder, in formats that others read."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.evaluation.maps import map_at
from scenarios.evaluation.metric import Metric
from scenarios.evaluation.segmentation import step_deviations, stitch_error
from scenarios.jsonable import dump
from scenarios.run_folder.arrays import SUBMAPS_FILE, TRACKS_FILE, write_submaps, write_tracks
from scenarios.run_folder.directory import METRICS_FILE, safe_name
from sim.record import SimulatedRun
from slam.formats import g2o, recording_npz, ros_map, tum
from slam.mapping.occupancy import Grid
from slam.odometry.track import Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import NoStitch
from stitch.alignment.result import Alternative
from stitch.mapping.estimate import Estimate, LoopCandidate

SCHEMA = 1
"""Version of the layout of metrics.json."""
STEP_COLUMNS = ("method", "scan", "time", "verdict", "reference", "matches", "error_trans", "error_rot")
STITCH_FIELDS = {name: name for name in ("T_a_b", "covariance", "score", "overlap_m2", "agreement", "belief")}
STITCH_FIELDS |= {"overlap_m2": "overlap_area"}
"""Key in stitches.json -> field of a ``Stitch``."""
WHITE = 255
"""Shade of free cells in the PNG maps, which are for looking at."""


@dataclass(frozen=True)
class Run:
    """What was ``asked`` (command line and every parameter), on what machine, and what came out."""

    asked: Mapping[str, object]
    environment: Mapping[str, object]
    seed: int
    recording: Recording
    estimates: Sequence[Estimate]
    metrics: Sequence[Metric]
    simulated: SimulatedRun | None = None

    def metrics_json(self) -> str:
        """The content of metrics.json."""
        content = {
            "schema": SCHEMA,
            "recording": self.recording.name,
            "corruptions": list(self.recording.corruptions),
            "seed": self.seed,
            "scans": len(self.recording),
            "distance_m": round(self.recording.distance, 3),
            "metrics": [metric.to_json() for metric in self.metrics],
        }
        return json.dumps(content, indent=1, allow_nan=False)


def write_run(folder: Path, run: Run) -> None:
    """Write everything into ``folder`` but environment.json, figures and page."""
    recording, estimates = run.recording, run.estimates
    dump(folder / "config.json", run.asked)
    recording_npz.write(folder / "recording.npz", recording)
    _write_trajectories(folder / "trajectories", recording, estimates)
    _write_graphs(folder / "posegraphs", estimates)
    _write_maps(folder / "maps", recording, estimates)
    _write_steps(folder / "steps.csv", recording, estimates)
    dump(folder / "segments.json", segments(estimates))
    dump(folder / "stitches.json", stitches(estimates, recording.truth))
    dump(folder / "self_consistency.json", {e.method: e.consistency for e in estimates if e.consistency})
    write_tracks(folder / TRACKS_FILE, estimates)
    write_submaps(folder / SUBMAPS_FILE, estimates, recording)
    (folder / METRICS_FILE).write_text(run.metrics_json() + "\n", encoding="utf-8")


def segments(estimates: Sequence[Estimate]) -> dict[str, list[dict[str, int]]]:
    """Method -> its segments, scans ``start..stop-1`` each."""
    cut = [estimate for estimate in estimates if estimate.submaps]
    return {e.method: [{"start": submap.start, "stop": submap.stop} for submap in e.submaps] for e in cut}


def stitches(estimates: Sequence[Estimate], truth: Array | None) -> dict[str, list[dict[str, object]]]:
    """Method -> an entry for every stitch it tried; with the errors against ``truth (N, 3)``."""
    tried = [estimate for estimate in estimates if estimate.stitches]
    return {e.method: [stitch_to_json(e, stitch, truth) for stitch in e.stitches] for e in tried}


def stitch_to_json(estimate: Estimate, candidate: LoopCandidate, truth: Array | None) -> dict[str, object]:
    """An entry of stitches.json: the pair and its prior, then the alignment, or why there is none; against
    ``truth (N, 3)`` also its error and whether it is false. ``scan`` is the last scan of b: in round
    (``turn``) 0 nothing later was known."""
    entry: dict[str, object] = {
        "a": candidate.a,
        "b": candidate.b,
        "turn": candidate.round,
        "scan": estimate.submaps[candidate.b].stop - 1,
        "prior": candidate.prior,
        "accepted": candidate.accepted,
        "weight": candidate.weight,
    }
    result = candidate.result
    if isinstance(result, NoStitch):
        return {**entry, "reason": result.reason, "best": result.best and _alternative(result.best)}
    entry |= {key: getattr(result, field) for key, field in STITCH_FIELDS.items()}
    entry["alternatives"] = [_alternative(alternative) for alternative in result.alternatives]
    error = None if truth is None else stitch_error(estimate, candidate, truth)
    if error is not None:
        entry |= {"error_m": error.translation, "error_deg": float(np.degrees(error.rotation))}
        entry["false"] = candidate.accepted and error.false
    return entry


def _alternative(alternative: Alternative) -> dict[str, object]:
    return {"T_a_b": alternative.T_a_b, "score": alternative.score}


def _write_trajectories(folder: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One TUM file per method, and the truth."""
    folder.mkdir()
    for name, poses in _poses(recording, estimates).items():
        tum.write(folder / f"{name}.tum", recording.time, poses)


def _poses(recording: Recording, estimates: Sequence[Estimate]) -> dict[str, Array]:
    """Poses ``(N, 3)`` by the name of a file: every method's, and the true ones where they are known."""
    poses = {safe_name(estimate.method): estimate.poses for estimate in estimates}
    return poses if recording.truth is None else {**poses, "truth": recording.truth}


def _write_graphs(folder: Path, estimates: Sequence[Estimate]) -> None:
    """The pose graphs before and after optimisation, of the methods that have one."""
    for estimate in estimates:
        for when, graph in (("before", estimate.graph_before), ("after", estimate.graph_after)):
            if graph is not None:
                folder.mkdir(exist_ok=True)
                g2o.write(folder / f"{safe_name(estimate.method)}-{when}.g2o", graph)


def _write_maps(folder: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """Each method's map in its own frame, and the one drawn with true poses: PNG, and PGM with YAML."""
    folder.mkdir()
    for name, poses in _poses(recording, estimates).items():
        try:
            grid = map_at(recording, poses)
        except ValueError as error:  # a method that lost itself can need a map larger than any disk
            (folder / f"{name}.txt").write_text(f"not drawn: {error}\n", encoding="utf-8")
            continue
        ros_map.write(folder / f"{name}.yaml", grid)
        (folder / f"{name}.png").write_bytes(_map_png(grid))


def _map_png(grid: Grid) -> bytes:
    """The map with a pixel per cell, north up."""
    import cv2

    free_or_unknown = np.where(grid.free, WHITE, ros_map.UNKNOWN)
    shades = np.where(grid.occupied, ros_map.OCCUPIED, free_or_unknown).astype(np.uint8)
    return bytes(cv2.imencode(".png", shades[::-1])[1])


def _write_steps(path: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One row per scan and method with a track: verdict, true error of the step [m, rad], confidence. The
    step is the one from the scan in the column ``reference``. What does not exist is an empty cell."""
    tracks = {estimate.method: estimate.track for estimate in estimates if estimate.track is not None}
    measures = list(dict.fromkeys(name for track in tracks.values() for name in track.confidence))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*STEP_COLUMNS, *measures])
        for method, track in tracks.items():
            x, y, yaw = step_deviations(track, recording.truth).T
            absent = np.full(len(track), np.nan)
            confidence = [track.confidence.get(name, absent) for name in measures]
            columns = [column.tolist() for column in (np.hypot(x, y), np.abs(yaw), *confidence)]
            for scan in range(len(track)):
                verdict, stamp = Verdict(track.verdict[scan]).name, repr(float(recording.time[scan]))
                numbers = ["" if c[scan] != c[scan] else f"{c[scan]:.9g}" for c in columns]
                row = (method, scan, stamp, verdict, track.reference[scan], track.matches[scan])
                writer.writerow([*row, *numbers])
