"""Maps as images, and as ROS's map_server reads them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenarios.evaluation.maps import map_at
from scenarios.run_folder.place import safe
from slam.formats import ros_map
from slam.mapping.occupancy import Grid
from slam.recording import Recording
from stitch.mapping.estimate import Estimate


def write(into: Path, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """Each method's map in its own frame, and the one drawn with true poses: PNG, and PGM with YAML."""
    into.mkdir()
    drawn = {safe(estimate.method): estimate.poses for estimate in estimates}
    if recording.truth is not None:
        drawn["truth"] = recording.truth
    for name, poses in drawn.items():
        try:
            grid = map_at(recording, poses)
        except ValueError as error:  # a method that lost itself can need a map larger than any disk
            (into / f"{name}.txt").write_text(f"not drawn: {error}\n", encoding="utf-8")
            continue
        ros_map.write(into / f"{name}.yaml", grid)
        (into / f"{name}.png").write_bytes(png(grid))


def png(grid: Grid) -> bytes:
    """The map with a pixel per cell, north up: walls black, free white, unknown grey."""
    import cv2

    shades = np.where(grid.occupied, 0, np.where(grid.free, 255, 205)).astype(np.uint8)
    done, data = cv2.imencode(".png", shades[::-1])
    if not done:
        raise RuntimeError(f"OpenCV cannot encode a map of {shades.shape} cells")
    return data.tobytes()
