"""A run's folder read back: the recording, and what every method said of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.evaluation.metric import Metric
from scenarios.run_folder import tracks
from scenarios.run_folder.place import MARK, safe
from slam.cli import InputError
from slam.formats import FormatError, g2o, load, tum
from slam.formats.recording_npz import TORN
from slam.graph.pose_graph import PoseGraph
from slam.mapping import keyframes
from slam.mapping.submap import Submap, cut
from slam.odometry.track import Track, Verdict
from slam.recording import Recording
from slam.scan import scans_of
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def is_run(folder: Path) -> bool:
    """True for the folder of a run."""
    return (folder / MARK).is_file()


def read_metrics(folder: Path) -> tuple[dict[str, Any], list[Metric]]:
    """What ``metrics.json`` says of the run, and its metrics. Raises `InputError`."""
    told = _json(folder / MARK)
    try:
        metrics = [
            Metric(m["metric"], m["value"], m["unit"], m["better"], m.get("reason"), m["method"])
            for m in told["metrics"]
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / MARK}: expected the metrics of a run: {error}") from error
    return told, metrics


def read(folder: Path) -> tuple[Recording, list[Estimate], list[Metric]]:
    """The recording, the estimates in the order of the metrics, and the metrics. Raises `InputError`.

    Submaps are cut anew from the recording at the poses of the front end.
    """
    if not is_run(folder):
        raise InputError(f"{folder}: expected the folder of a run, with {MARK}")
    _, metrics = read_metrics(folder)
    segments, stories = _json(folder / "segments.json"), _json(folder / "stitches.json")
    try:
        recording = load(folder / "recording.npz")
        with np.load(folder / "tracks.npz", allow_pickle=False) as arrays:
            estimates = [
                _estimate(folder, method, recording, arrays, segments, stories)
                for method in dict.fromkeys(metric.method for metric in metrics)
                if _trajectory(folder, method).is_file()  # a method may have had no answer
            ]
    except (FormatError, *TORN) as error:
        raise InputError(f"{folder}: cannot be read as a run: {error}") from error
    return recording, estimates, metrics


def _estimate(
    folder: Path,
    method: str,
    recording: Recording,
    arrays: Mapping[str, np.ndarray],
    segments: Mapping[str, Any],
    stories: Mapping[str, Any],
) -> Estimate:
    _, poses = tum.read(_trajectory(folder, method))
    track = tracks.read(arrays, method)
    name = f"{method}/{tracks.COVARIANCE}"
    return Estimate(
        method,
        poses,
        covariance=arrays.get(name),
        track=track,
        submaps=_submaps(recording, track, segments[method]) if track and method in segments else (),
        stitches=tuple(_tried(story) for story in stories.get(method, [])),
        graph_before=_graph(folder, method, "before"),
        graph_after=_graph(folder, method, "after"),
    )


def _trajectory(folder: Path, method: str) -> Path:
    return folder / "trajectories" / f"{safe(method)}.tum"


def _submaps(recording: Recording, track: Track, segments: list[dict[str, int]]) -> tuple[Submap, ...]:
    scans = scans_of(recording)
    matched = track.verdict != Verdict.FELL_BACK
    drawn = np.array([k for k in keyframes.choose(track.poses) if matched[k]], dtype=np.int64)
    return tuple(
        cut(recording, scans, track.poses, s["start"], s["stop"], np.union1d(drawn, s["start"]))
        for s in segments
    )


def _tried(story: Mapping[str, Any]) -> LoopCandidate:
    result = _stitch(story) if "T_a_b" in story else _refusal(story)
    prior = None
    if story["prior"] is not None:
        prior = Prior(np.array(story["prior"]["T_a_b"]), np.array(story["prior"]["covariance"]))
    return LoopCandidate(story["a"], story["b"], result, story["weight"], prior=prior, round=story["turn"])


def _stitch(story: Mapping[str, Any]) -> Stitch:
    sigma = story["covariance"]
    return Stitch(
        np.array(story["T_a_b"]),
        None if sigma is None else np.array(sigma),
        story["score"],
        story["overlap_m2"],
        story["agreement"],
        tuple(_alternative(other) for other in story["alternatives"]),
        story["belief"],
    )


def _refusal(story: Mapping[str, Any]) -> NoStitch:
    return NoStitch(story["reason"], None if story["best"] is None else _alternative(story["best"]))


def _alternative(told: Mapping[str, Any]) -> Alternative:
    return Alternative(np.array(told["T_a_b"]), float(told["score"]))


def _graph(folder: Path, method: str, when: str) -> PoseGraph | None:
    path = folder / "posegraphs" / f"{safe(method)}-{when}.g2o"
    return g2o.read(path) if path.is_file() else None


def _json(path: Path) -> dict[str, Any]:
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected JSON of a run: {error}") from error
    if not isinstance(told, dict):
        raise InputError(f"{path}: expected JSON of a run, got {type(told).__name__}")
    return told
