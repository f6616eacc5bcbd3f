"""Trajectories and pose graphs, in the formats others read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scenarios.run_folder.place import safe
from slam.formats import g2o, tum
from slam.recording import Recording
from stitch.mapping.estimate import Estimate


def write_trajectories(into: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """One TUM file per method, and the truth."""
    into.mkdir()
    for estimate in estimates:
        tum.write(into / f"{safe(estimate.method)}.tum", recording.time, estimate.poses)
    if recording.truth is not None:
        tum.write(into / "truth.tum", recording.time, recording.truth)


def write_graphs(into: Path, estimates: Sequence[Estimate]) -> None:
    """The pose graphs before and after optimisation, of the methods that have one."""
    for estimate in estimates:
        for when, graph in (("before", estimate.graph_before), ("after", estimate.graph_after)):
            if graph is not None:
                into.mkdir(exist_ok=True)
                g2o.write(into / f"{safe(estimate.method)}-{when}.g2o", graph)
