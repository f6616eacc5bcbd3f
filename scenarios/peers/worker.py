"""The process that a peer runs in: python -m scenarios.peers.worker NAME SETTINGS FOLDER."""

from __future__ import annotations

import resource
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

RECORDING, POSES = "recording.npz", "poses.npz"


def work(words: Sequence[str]) -> None:
    """Read the recording in a folder, run the peer, and write its poses with the wall time [s] and the peak
    memory [MB] of it and its programs."""
    from rich.console import Console

    from scenarios.peers import PEERS
    from scenarios.stages import Stages
    from slam.formats import recording_npz

    name, settings, folder = words
    module, _, function = PEERS[name].solve.partition(":")
    solve = getattr(import_module(module), function)
    recording = recording_npz.read(Path(folder) / RECORDING)
    stages = Stages(Console(quiet=True))
    with stages.stage(name):
        poses = solve(recording, settings, Path(folder))
    programs = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
    peak = max(stages.costs[name].peak_mb or 0.0, programs)
    cost = {"wall_s": stages.costs[name].wall_s, "peak_mb": peak}
    np.savez(Path(folder) / POSES, time=recording.time, poses=poses, **cost)  # type: ignore[arg-type]


if __name__ == "__main__":
    work(sys.argv[1:])
