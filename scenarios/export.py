"""python -m scenarios.export NAME | LOG --format F -o FILE: a recording for other systems to run on."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.options import check_seed
from slam.cli import InputError, main

if TYPE_CHECKING:
    from slam.recording import Recording, Relations

COMMAND = "scenarios.export"

Format = Literal["usarsim", "carmen", "rosbag"]


@dataclass(frozen=True)
class Options:
    """Write a scenario's drive, or a recording, as a USARSim log, a CARMEN log or a ROS 2 bag.

    A CARMEN log gets a file of true relations beside it, as far as the truth is known.
    """

    recording: Positional[Annotated[str, arg(metavar="NAME|LOG")]]
    """A scenario (python -m scenarios.run --list), a ROS map to drive through (.yaml), or a recording."""
    format: Annotated[Format, arg(help_behavior_hint="")]
    """usarsim and carmen write a file, rosbag a folder."""
    out: Annotated[Path, arg(aliases=["-o"], metavar="FILE", help_behavior_hint="")]
    """What to write."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """Which of a scenario's drives to simulate."""


def run(options: Options) -> None:
    """Obtain the recording, write it, and say what was written on stdout."""
    check_seed(options.seed)
    if not options.out.parent.is_dir():
        raise InputError(f"{options.out.parent}: no such folder")
    if options.out.exists():
        raise InputError(f"{options.out}: exists already, expected a new name")
    recording = obtain(options.recording, options.seed)
    try:
        written = write(recording, options.format, options.out)
    except (ValueError, OSError) as error:  # beams the format cannot say, a disk that is full
        raise InputError(str(error)) from error
    for path in written:
        print(path)


def obtain(target: str, seed: int) -> Recording:
    """The recording, simulated or read. Raises `InputError`."""
    from scenarios import source

    if source.is_scenario(target):
        return source.simulated(target, seed).recording
    return source.logged(Path(target), None, None).recording


def write(recording: Recording, form: Format, path: Path) -> list[Path]:
    """Write ``recording`` to ``path``; returns what was written: for CARMEN the relations too, where known.

    Raises ``ValueError`` for what the format cannot hold.
    """
    from slam.formats import carmen, usarsim
    from slam.formats import relations as relations_file
    from slam.formats.rosbag import writer as rosbag

    if form == "rosbag":
        rosbag.write(path, recording)
        return [path]
    (usarsim if form == "usarsim" else carmen).write(path, recording)
    known = relations(recording) if form == "carmen" else None
    if known is None:
        return [path]
    beside = path.with_suffix(".relations")
    relations_file.write(beside, known)
    return [path, beside]


def relations(recording: Recording) -> Relations | None:
    """The recording's own relations, else those of its truth with stamps beyond doubt; None without either.

    Like the benchmark's they are between poses of the laser. A stamp with a second odometry record within
    10 ms is left out (Kümmerle et al. 2009 name poses by their stamps alone).
    """
    import numpy as np

    from scenarios.evaluation.relations import CLEAR_WINDOW, relations_from_truth
    from slam import se2
    from slam.recording import Relations

    if recording.relations is not None or recording.truth is None or len(recording) < 2:
        return recording.relations
    truth = se2.compose(recording.truth, recording.laser.T_robot_laser)
    pairs = relations_from_truth(truth)
    stamps = recording.time
    if recording.odometry is not None:
        own = recording.odometry.time[recording.odometry.scan_row] == stamps
        stamps = np.concatenate([recording.odometry.time, stamps[~own]])
    stamps = np.sort(stamps)
    near = np.searchsorted(stamps, recording.time + CLEAR_WINDOW, side="right")
    near -= np.searchsorted(stamps, recording.time - CLEAR_WINDOW, side="left")
    clear = np.all(near[pairs.rows] <= 1, axis=1)
    return Relations(recording.time[pairs.rows[clear]], pairs.T_12[clear]) if np.any(clear) else None


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
