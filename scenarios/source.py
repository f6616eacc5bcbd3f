"""Where a recording comes from: a scenario of the catalogue or a map, simulated, or a log."""

from __future__ import annotations

import glob
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.catalogue import CATALOGUE
from slam.cli import InputError, Pose, nearest

if TYPE_CHECKING:
    from sim.record import Buildable, DeadReckoning, SimulatedRun
    from slam.odometry.laser_mount import Mount, NoMount
    from slam.recording import Recording
    from stitch.mapping.config import MappingConfig
    from stitch.mapping.estimate import Estimate

MAP_SUFFIXES = (".yaml", ".yml")
"""A ROS map is named after its yaml file."""


@dataclass(frozen=True)
class Source:
    """A recording, the ``settings`` of its scenario (empty for a log), what others answered for it,
    and what only its simulator knows (None for a log)."""

    recording: Recording
    settings: Mapping[str, object]
    published: tuple[Estimate, ...] = ()
    simulated: SimulatedRun | None = None


def is_scenario(target: str) -> bool:
    """True when ``target`` is simulated: a scenario's name or a ROS map, not a log.

    Raises `InputError` for a name that is none of them, with the nearest scenario.
    """
    if target in CATALOGUE:
        return True
    if os.path.exists(target):
        return is_map(target)
    if Path(target).suffix or len(Path(target).parts) > 1:
        raise InputError(f"{target}: no such file, expected a recording or a ROS map")
    raise InputError(f"unknown scenario {target!r}: {nearest(target, CATALOGUE)}")


def is_map(target: str) -> bool:
    """True for what is named as ROS maps are."""
    return Path(target).suffix.lower() in MAP_SUFFIXES


def simulated(
    target: str, seed: int, start: Pose | None = None, dead_reckoning: DeadReckoning | None = None
) -> Source:
    """A drive through a scenario of the catalogue or a ROS map; of its settings all but the world itself.

    ``start`` is where a drive through a map begins; None: drawn. ``dead_reckoning`` overrides the scenario's
    choice. Raises `InputError` for a map that cannot be read or driven through.
    """
    from sim.record import simulate

    run = simulate(_scenario(target, start), seed, dead_reckoning)
    settings = {f.name: getattr(run.setup, f.name) for f in fields(run.setup) if f.name != "world"}
    return Source(run.recording, {**settings, "ending": run.ending}, simulated=run)


def _scenario(target: str, start: Pose | None) -> Buildable:
    if target in CATALOGUE:
        return CATALOGUE[target]
    from scenarios.catalogue.ros_map import MappedBuilding

    building = MappedBuilding(Path(target), start)
    for note in building.map.notes:
        print(note, file=sys.stderr)
    return building


def logged(
    path: Path,
    relations: Path | None,
    mount: Pose | None,
    *,
    field_of_view: float | None = None,
    topic: str = "",
    odometry: str = "",
) -> Source:
    """A recording from a log, with relations to score it against, and the laser mount and field of view
    [degrees] that the user may know.

    ``topic`` and ``odometry`` name what is read of a ROS bag.

    Answers of other systems are read where they lie beside the log. Raises `InputError` for files that cannot
    be read and for relations that match nothing.
    """
    import numpy as np

    from scenarios.evaluation.relations import relation_pairs
    from slam.formats import FormatError, load

    try:
        recording = load(path, relations, field_of_view=field_of_view, topic=topic, odometry=odometry)
    except FormatError as error:
        raise InputError(str(error)) from error
    published = _published(path, recording)
    if mount is not None:
        recording = recording.with_laser_mount(np.array(mount), "--laser-mount")
    try:
        relation_pairs(recording)
    except ValueError as error:
        raise InputError(f"{relations or path}: {error}") from error
    return Source(recording, {}, published)


def with_estimated_mount(found: Source, config: MappingConfig) -> tuple[Source, Mount | NoMount]:
    """A recording whose mount is unstated, with its laser where the drive itself says it is; and that mount.

    Where it is, with the reason, where the drive tells of none. Published answers, made with the laser for
    the robot, become the robot's.
    """
    from slam import se2
    from slam.odometry.laser_mount import Mount, find_mount

    mount = find_mount(found.recording, config.frontend, config.mount, config.mending)
    if not isinstance(mount, Mount):  # nothing needs to look again
        at_origin = found.recording.laser.T_robot_laser
        return replace(found, recording=found.recording.with_laser_mount(at_origin, mount.reason)), mount
    T_laser_robot = se2.inverse(mount.T_robot_laser)
    published = [replace(peer, poses=se2.compose(peer.poses, T_laser_robot)) for peer in found.published]
    recording = found.recording.with_laser_mount(mount.T_robot_laser, "the drive")
    return replace(found, recording=recording, published=tuple(published)), mount


def _published(path: Path, recording: Recording) -> tuple[Estimate, ...]:
    """Other systems' answers beside a log, as `scenarios.score` takes them: for ``intel.raw.log.gz`` there is
    ``intel.gmapping_ref.txt``. Raises `InputError`."""
    from scenarios.score.answers import TOLERANCE, read_answers, to_estimate
    from slam.formats.text import recording_name
    from stitch.mapping.estimate import NoEstimate

    stem = recording_name(path).removesuffix(".raw")
    published: list[Estimate] = []
    for file in sorted(path.parent.glob(f"{glob.escape(stem)}.*_ref.txt")):
        (answer,) = read_answers([file])
        name = f"{file.name.removeprefix(f'{stem}.').removesuffix('_ref.txt')} (published)"
        assert answer.trajectory is not None  # the file is named .txt
        if len(answer.trajectory) != len(recording):
            expected = f"expected one for each of {len(recording)} scans"
            raise InputError(f"{file}: {len(answer.trajectory)} poses, {expected}")
        estimate, _ = to_estimate(name, answer.trajectory, recording, TOLERANCE, "robot")
        if isinstance(estimate, NoEstimate):
            raise InputError(f"{file}: {estimate.reason}")
        published.append(estimate)
    return tuple(published)
