"""The folder of a run: written to a temporary one beside it, renamed when complete."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.cli import BadInput
from scenarios.environment import environment
from scenarios.estimate import Estimate, TriedStitch
from scenarios.evaluation import Metric
from scenarios.stages import Cost
from slam import occupancy, se2
from slam.recording import Recording
from slam.track import Verdict
from stitch.align import Stitch

SCHEMA = 1
MAP_RESOLUTION = 0.05


@dataclass(frozen=True)
class Folder:
    """Where a run is being written, and where it will be found."""

    temporary: Path
    final: Path


@contextmanager
def prepare(out: Path, name: str) -> Iterator[Folder]:
    """A temporary folder in ``out``, gone when the run fails. Raises `BadInput` when ``out`` cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=out))
    except OSError as error:
        raise BadInput(f"--out {out}: cannot be written: {error.strerror or error}") from error
    try:
        yield Folder(temporary, out / safe(name))
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def publish(folder: Folder, costs: Mapping[str, Cost]) -> None:
    """Note what all stages cost, give the folder its name and let ``latest`` point at it."""
    _dump(folder.temporary / "environment.json", environment(costs))
    folder.temporary.chmod(0o755)
    if folder.final.exists():
        shutil.rmtree(folder.final)
    folder.temporary.rename(folder.final)
    latest = folder.final.parent / "latest"
    if latest.is_symlink() or not latest.exists():
        latest.unlink(missing_ok=True)
        latest.symlink_to(folder.final.name, target_is_directory=True)


def write(
    folder: Folder,
    recording: Recording,
    estimates: Sequence[Estimate],
    metrics: Sequence[Metric],
    facts: Mapping[str, Any],
) -> None:
    """Everything but the environment: configuration, recording, trajectories, maps, steps, stitches, metrics, page."""
    from scenarios.report.page import render
    from slam.formats import recording_npz

    into = folder.temporary
    _dump(into / "config.json", {"command": facts["command"], "seed": facts["seed"], "methods": facts["config"]})
    recording_npz.write(into / "recording.npz", recording)
    write_trajectories(into / "trajectories", recording, estimates)
    write_maps(into / "maps", recording, estimates)
    write_graphs(into, estimates)
    write_steps(into / "steps.csv", recording, estimates)
    _dump(into / "segments.json", {e.method: _segments(e) for e in estimates if e.submaps})
    _dump(into / "stitches.json", {e.method: [_stitch(s) for s in e.stitches] for e in estimates if e.stitches})
    (into / "metrics.json").write_text(metrics_json(recording, facts["seed"], metrics) + "\n")
    (into / "report.html").write_text(render(recording, estimates, metrics, told(facts)), encoding="utf-8")


def metrics_json(recording: Recording, seed: int, metrics: Sequence[Metric]) -> str:
    """The metrics of a run as JSON text."""
    content = {
        "schema": SCHEMA,
        "recording": recording.name,
        "seed": seed,
        "scans": len(recording),
        "distance_m": round(recording.distance, 3),
        "metrics": [metric.to_json() for metric in metrics],
    }
    return json.dumps(content, indent=1, allow_nan=False)


def told(facts: Mapping[str, Any]) -> dict[str, object]:
    """What the page says of how it was made."""
    made = facts["environment"]
    packages = ", ".join(f"{name} {number}" for name, number in made["packages"].items())
    return {
        "command": facts["command"],
        "seed": facts["seed"],
        "code": made["git"] or made["slamstitch"],
        "python": made["python"],
        "packages": packages,
        "processor": f"{made['processor']}, {made['cores']} cores",
    }


def write_trajectories(into: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One TUM file per method, and the truth."""
    from slam.formats import tum

    into.mkdir()
    for estimate in estimates:
        tum.write(into / f"{safe(estimate.method)}.tum", recording.time, estimate.poses)
    if recording.truth is not None:
        tum.write(into / "truth.tum", recording.time, recording.truth)


def write_maps(into: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """Each method's map, and the one drawn with true poses, as PNG to look at and as ROS map."""
    from scenarios.report import figures
    from scenarios.report.style import png
    from slam.formats import ros_map

    into.mkdir()
    drawn = list(estimates)
    if recording.truth is not None:
        drawn.append(Estimate("truth", recording.truth))
    for estimate in drawn:
        name = safe(estimate.method)
        try:
            grid = occupancy.draw(
                estimate.poses, recording.ranges, recording.angles, recording.laser, MAP_RESOLUTION
            )
        except ValueError as error:  # a method that lost itself can need a map larger than any disk
            (into / f"{name}.txt").write_text(f"not drawn: {error}\n")
            continue
        (into / f"{name}.png").write_bytes(png(figures.single_map(recording, estimate)))
        ros_map.write(into / f"{name}.yaml", grid)


def write_graphs(into: Path, estimates: Sequence[Estimate]) -> None:
    """The pose graph before and after optimisation, for the methods that have one."""
    from slam.formats import g2o

    for estimate in estimates:
        if estimate.graph_before is not None and estimate.graph_after is not None:
            g2o.write(into / f"{safe(estimate.method)}-before.g2o", estimate.graph_before)
            g2o.write(into / f"{safe(estimate.method)}-after.g2o", estimate.graph_after)


def write_steps(path: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One row per scan and method with a track: true error of the step, verdict, and every confidence measure."""
    tracked = [estimate for estimate in estimates if estimate.track is not None]
    measures = list(tracked[0].track.confidence) if tracked and tracked[0].track else []
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "scan", "time", "verdict", "reference", "matches", "error_trans", "error_rot", *measures])
        for estimate in tracked:
            writer.writerows(_step_rows(recording, estimate, measures))


def _step_rows(recording: Recording, estimate: Estimate, measures: Sequence[str]) -> Iterator[list[object]]:
    track = estimate.track
    assert track is not None
    for k in range(len(recording)):
        reference = int(track.reference[k])
        error: list[object] = ["", ""]
        if recording.truth is not None and reference >= 0:
            true = se2.between(recording.truth[reference], recording.truth[k])
            off = se2.between(true, se2.between(track.poses[reference], track.poses[k]))
            error = [f"{np.hypot(off[0], off[1]):.6f}", f"{abs(off[2]):.6f}"]
        values = [_cell(track.confidence[name][k]) for name in measures]
        verdict = Verdict(track.verdict[k]).name
        yield [estimate.method, k, repr(float(recording.time[k])), verdict, reference, int(track.matches[k]), *error, *values]


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}"


def _segments(estimate: Estimate) -> list[dict[str, int]]:
    return [{"start": submap.start, "stop": submap.stop} for submap in estimate.submaps]


def _stitch(tried: TriedStitch) -> dict[str, object]:
    """The story of a stitch."""
    story: dict[str, object] = {"a": tried.a, "b": tried.b, "accepted": tried.accepted, "weight": tried.weight}
    result = tried.result
    if not isinstance(result, Stitch):
        return {**story, "reason": result.reason}
    return {
        **story,
        "T_a_b": result.T_a_b,
        "covariance": result.covariance,
        "score": result.score,
        "overlap_m2": result.overlap_area,
        "agreement": result.agreement,
        "alternatives": [{"T_a_b": other.T_a_b, "score": other.score} for other in result.alternatives],
    }


def safe(name: str) -> str:
    """A name that is one plain file name on every system."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._") or "unnamed"


def _dump(path: Path, content: object) -> None:
    path.write_text(json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    """A value as JSON has it: data classes as objects, arrays as lists, what is not finite as a word."""
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value
