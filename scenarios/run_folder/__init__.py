"""The folder of a run: everything that was asked, measured and drawn."""

from __future__ import annotations

from scenarios.run_folder.contents import Run
from scenarios.run_folder.place import Folder, check, prepare, publish
from scenarios.run_folder.plain import dump

__all__ = ["Folder", "Run", "check", "prepare", "publish", "write"]


def write(folder: Folder, run: Run) -> None:
    """Everything but what the stages cost: that is known when all of this is written."""
    from scenarios.run_folder import maps, stitches
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
    (into / "report.html").write_text(page(run), encoding="utf-8")
