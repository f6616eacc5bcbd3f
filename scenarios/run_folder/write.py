"""Writes what a run found into its folder, in formats that others read."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.evaluation.maps import map_at
from scenarios.evaluation.metric import Metric
from scenarios.evaluation.segmentation import step_deviations
from scenarios.jsonable import dump
from scenarios.run_folder.arrays import SUBMAPS_FILE, TRACKS_FILE, write_submaps, write_tracks
from scenarios.run_folder.directory import METRICS_FILE, safe_name
from scenarios.run_folder.stitches import stitch_to_json
from sim.record import SimulatedRun
from slam.formats import g2o, recording_npz, ros_map, tum
from slam.mapping.occupancy import Grid
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

SCHEMA = 1
"""Version of the layout of metrics.json."""
STEP_COLUMNS = ("method", "scan", "time", "verdict", "reference", "matches", "error_trans", "error_rot")
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
    write_tracks(folder / TRACKS_FILE, estimates)
    write_submaps(folder / SUBMAPS_FILE, estimates)
    (folder / METRICS_FILE).write_text(run.metrics_json() + "\n", encoding="utf-8")


def segments(estimates: Sequence[Estimate]) -> dict[str, list[dict[str, int]]]:
    """Method -> its segments, scans ``start..stop-1`` each."""
    return {
        estimate.method: [{"start": submap.start, "stop": submap.stop} for submap in estimate.submaps]
        for estimate in estimates
        if estimate.submaps
    }


def stitches(estimates: Sequence[Estimate], truth: Array | None) -> dict[str, list[dict[str, object]]]:
    """Method -> an entry for every stitch it tried; with the errors against ``truth (N, 3)``."""
    return {
        estimate.method: [stitch_to_json(estimate, stitch, truth) for stitch in estimate.stitches]
        for estimate in estimates
        if estimate.stitches
    }


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
    ok, data = cv2.imencode(".png", shades[::-1])
    if not ok:
        raise RuntimeError(f"OpenCV cannot encode a map of {shades.shape} cells")
    return data.tobytes()


def _write_steps(path: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One row per scan and method with a track: verdict, true error of the step [m, rad], confidence.

    The step is the one from the scan in the column ``reference``. What does not exist is an empty cell.
    """
    tracks = {estimate.method: estimate.track for estimate in estimates if estimate.track is not None}
    measures = list(dict.fromkeys(name for track in tracks.values() for name in track.confidence))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*STEP_COLUMNS, *measures])
        for method, track in tracks.items():
            writer.writerows(_step_rows(method, track, recording, measures))


def _step_rows(
    method: str, track: Track, recording: Recording, measures: Sequence[str]
) -> Iterator[tuple[object, ...]]:
    absent = np.full(len(track), np.nan)
    x, y, yaw = step_deviations(track, recording.truth).T
    numbers = [np.hypot(x, y), np.abs(yaw), *(track.confidence.get(name, absent) for name in measures)]
    return zip(
        [method] * len(track),
        range(len(track)),
        map(repr, recording.time.tolist()),
        (Verdict(verdict).name for verdict in track.verdict),
        track.reference.tolist(),
        track.matches.tolist(),
        *(["" if value != value else f"{value:.9g}" for value in column.tolist()] for column in numbers),
        strict=True,
    )
