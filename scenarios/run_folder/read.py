"""Reads a run's folder back: the recording, and what every method answered."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.evaluation.metric import Metric
from scenarios.run_folder.arrays import COVARIANCE, SUBMAPS_FILE, TRACKS_FILE, read_submaps, read_track
from scenarios.run_folder.directory import METRICS_FILE, safe_name
from slam.cli import InputError
from slam.formats import FormatError, g2o, load, tum
from slam.formats.recording_npz import TORN
from slam.graph.pose_graph import PoseGraph
from slam.recording import Recording
from slam.scan import scans_of
from stitch.align import Alternative, NoStitch, Prior, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def is_run(folder: Path) -> bool:
    """True for the folder of a run."""
    return (folder / METRICS_FILE).is_file()


def read_metrics(folder: Path) -> tuple[dict[str, Any], list[Metric]]:
    """The content of ``metrics.json``, and its metrics. Raises `InputError`."""
    content = _json(folder / METRICS_FILE)
    try:
        metrics = [
            Metric(m["metric"], m["value"], m["unit"], m["better"], m.get("reason"), m["method"])
            for m in content["metrics"]
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / METRICS_FILE}: expected the metrics of a run: {error}") from error
    return content, metrics


def read_run(folder: Path) -> tuple[Recording, list[Estimate], list[Metric]]:
    """The recording, the estimates in the order of the metrics, and the metrics. Raises `InputError` for a
    folder that is no run, is damaged, or was written before submaps were stored."""
    if not is_run(folder):
        raise InputError(f"{folder}: expected the folder of a run, with {METRICS_FILE}")
    _, metrics = read_metrics(folder)
    stitches = _json(folder / "stitches.json")
    if not (folder / SUBMAPS_FILE).is_file():
        raise InputError(
            f"{folder}: a run of an older version, without {SUBMAPS_FILE}: "
            "make it again with the command in its config.json"
        )
    try:
        recording = load(folder / "recording.npz")
        scans = scans_of(recording)
        with (
            np.load(folder / TRACKS_FILE, allow_pickle=False) as tracks,
            np.load(folder / SUBMAPS_FILE, allow_pickle=False) as submaps,
        ):
            estimates = [
                Estimate(
                    method,
                    tum.read(_trajectory(folder, method))[1],
                    covariance=tracks.get(f"{method}/{COVARIANCE}"),
                    track=read_track(tracks, method),
                    submaps=read_submaps(submaps, method, scans),
                    stitches=tuple(map(stitch_from_json, stitches.get(method, []))),
                    graph_before=_graph(folder, method, "before"),
                    graph_after=_graph(folder, method, "after"),
                )
                for method in dict.fromkeys(metric.method for metric in metrics)
                if _trajectory(folder, method).is_file()  # a method may have had no answer
            ]
    except (FormatError, *TORN) as error:
        raise InputError(f"{folder}: cannot be read as a run: {error}") from error
    return recording, estimates, metrics


def stitch_from_json(entry: Mapping[str, Any]) -> LoopCandidate:
    """The candidate of an entry of stitches.json. Raises ``KeyError`` for an entry without all of it."""
    prior = entry["prior"]
    result: Stitch | NoStitch
    if "T_a_b" in entry:
        result = Stitch(
            np.array(entry["T_a_b"]),
            None if entry["covariance"] is None else np.array(entry["covariance"]),
            entry["score"],
            entry["overlap_m2"],
            entry["agreement"],
            tuple(map(_alternative, entry["alternatives"])),
            entry["belief"],
        )
    else:
        result = NoStitch(entry["reason"], None if entry["best"] is None else _alternative(entry["best"]))
    if prior is not None:
        prior = Prior(np.array(prior["T_a_b"]), np.array(prior["covariance"]))
    return LoopCandidate(entry["a"], entry["b"], result, entry["weight"], entry["turn"], prior)


def _alternative(entry: Mapping[str, Any]) -> Alternative:
    return Alternative(np.array(entry["T_a_b"]), float(entry["score"]))


def _trajectory(folder: Path, method: str) -> Path:
    return folder / "trajectories" / f"{safe_name(method)}.tum"


def _graph(folder: Path, method: str, when: str) -> PoseGraph | None:
    path = folder / "posegraphs" / f"{safe_name(method)}-{when}.g2o"
    return g2o.read(path) if path.is_file() else None


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON of a run: {error}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected JSON of a run, got {type(content).__name__}")
    return content
