"""python -m scenarios.export NAME | LOG --format F -o FILE: a recording for other systems to run on."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios import source
from scenarios.corruptions import Corrupt, corrupted, parse_corruptions
from scenarios.options import check_seed
from slam.cli import POSE, InputError, Pose, main

if TYPE_CHECKING:
    from slam.recording import Recording

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
    corrupt: Corrupt = ()
    """Spoil the recording first, as `python -m scenarios.run` does; the log then has one pose of dead
    reckoning for every scan."""
    poses: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """Write the CARMEN log with these poses for those it has, in every line of it: what Freiburg's
    metricEvaluator scores. A trajectory as python -m scenarios.score takes it."""
    laser_mount: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """With --poses, where the laser sits in the robot's frame in m and rad, if a log does not tell; without,
    it is estimated from the drive as in a run."""


def run(options: Options) -> None:
    """Obtain the recording, write it, and say what was written on stdout."""
    check_seed(options.seed)
    corruptions = parse_corruptions(options.corrupt)
    if options.poses and options.format != "carmen":
        raise InputError(f"--poses corrects a CARMEN log, expected --format carmen, got {options.format}")
    if options.laser_mount and not options.poses:
        raise InputError("--laser-mount is for --poses: a recording is written with the mount it has")
    if options.corrupt and options.poses:
        raise InputError(
            "--corrupt and --poses: the lines of the log itself are corrected, expected one of them"
        )
    if not options.out.parent.is_dir():
        raise InputError(f"{options.out.parent}: no such folder")
    if options.out.exists():
        raise InputError(f"{options.out}: exists already, expected a new name")
    if source.is_scenario(options.recording):
        recording = source.simulated(options.recording, options.seed).recording
    else:
        recording = source.logged(Path(options.recording), None, options.laser_mount).recording
    recording = corrupted(recording, corruptions, options.seed)
    try:
        if options.poses:
            from scenarios.score.corrected import write_corrected

            written = [write_corrected(options.out, options.poses, recording, Path(options.recording))]
        else:
            written = write(recording, options.format, options.out)
    except (ValueError, OSError) as error:  # beams the format cannot say, a disk that is full
        raise InputError(str(error)) from error
    for path in written:
        print(path)


def write(recording: Recording, form: Format, path: Path) -> list[Path]:
    """Write ``recording`` to ``path``; returns what was written: for CARMEN the relations too, where known.

    Raises ``ValueError`` for what the format cannot hold.
    """
    from scenarios.evaluation.relations import clear_relations
    from slam.formats import carmen, usarsim
    from slam.formats import relations as relations_file
    from slam.formats.rosbag import writer as rosbag

    {"rosbag": rosbag, "usarsim": usarsim, "carmen": carmen}[form].write(path, recording)
    known = clear_relations(recording) if form == "carmen" else None
    if known is None:
        return [path]
    beside = path.with_suffix(".relations")
    relations_file.write(beside, known)
    return [path, beside]


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
