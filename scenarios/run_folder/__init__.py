"""The folder of a run: everything that was asked, measured and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from scenarios.jsonable import dump
from scenarios.run_folder.contents import Run
from scenarios.run_folder.place import Folder, check, prepare, publish

if TYPE_CHECKING:
    from scenarios.stages import Cost

__all__ = ["Folder", "Run", "check", "prepare", "publish", "write"]


def write(folder: Folder, run: Run, stages: Mapping[str, Cost]) -> None:
    """Everything but what the stages cost: that is known when all of this is written. The page tells what the
    ``stages`` so far did."""
    from scenarios.report import album
    from scenarios.run_folder import maps, stitches, tracks
    from scenarios.run_folder.metrics import metrics_json
    from scenarios.run_folder.poses import write_graphs, write_trajectories
    from scenarios.run_folder.report import page
    from scenarios.run_folder.steps import write_steps
    from slam.formats import recording_npz

    into = folder.temporary
    dump(into / "config.json", run.asked)
    recording_npz.write(into / "recording.npz", run.recording)
    write_trajectories(into / "trajectories", run.recording, run.estimates)
    write_graphs(into / "posegraphs", run.estimates)
    maps.write(into / "maps", run.recording, run.estimates)
    write_steps(into / "steps.csv", run.recording, run.estimates)
    dump(into / "segments.json", stitches.segments(run.estimates))
    dump(into / "stitches.json", stitches.stories(run.estimates, run.recording.truth))
    (into / "metrics.json").write_text(metrics_json(run) + "\n", encoding="utf-8")
    tracks.write(into / "tracks.npz", run.estimates)
    drawings = album.drawings(run.recording, run.estimates, run.metrics, run.simulated)
    plates = [drawing.plate() for drawing in drawings]
    album.write(into / "figures", plates)
    (into / "report.html").write_text(page(run, plates, stages), encoding="utf-8")
