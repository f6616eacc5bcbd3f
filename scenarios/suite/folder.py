"""The suite's folder as it is written and read back: recordings, cards and hashes; the truth apart."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.catalogue import CATALOGUE
from scenarios.evaluation.relations import clear_relations
from scenarios.jsonable import dump
from scenarios.suite.version import Entry, fingerprint, suite
from slam.cli import InputError
from slam.formats import FORMATS, FormatError, load, relations, tum
from slam.recording import Recording
from slam.se2 import Array

SUITE_FILE, CARD = "suite.json", "card.md"
SCHEMA = 1
SUFFIXES = {"rosbag": ".bag2", "carmen": ".log", "usarsim": ".usarsim.log", "npz": ".npz"}
"""Format → what the file or folder of a recording ends with."""


def truth_folder(folder: Path) -> Path:
    """Where the truth of the suite in ``folder`` is."""
    return folder.with_name(f"{folder.name}-truth")


def write_entry(folder: Path, entry: Entry, recording: Recording, formats: Iterable[str]) -> dict[str, Any]:
    """Write a recording without its truth, in ``formats`` and as an npz, with its card. Returns what
    suite.json says of it. Raises ``ValueError`` for what a format cannot hold."""
    place = folder / entry.name
    place.mkdir()
    blind = replace(recording, name=entry.name, truth=None, relations=None)
    for form in dict.fromkeys([*formats, "npz"]):
        write = FORMATS[form].write
        assert write is not None  # all of SUFFIXES are written
        write(place / f"{entry.name}{SUFFIXES[form]}", blind)
    (place / CARD).write_text(card(entry, recording), encoding="utf-8")
    digest = fingerprint(recording)
    return {
        **asdict(entry),
        "scans": len(recording),
        "fingerprint": digest,
        "frozen": suite().frozen.get(entry.name) == digest,
        "files": hashes(place),
    }


def write_truth(folder: Path, name: str, recording: Recording) -> str:
    """Write the truth of a recording into a folder, as TUM and as relations; returns the SHA-256 of the
    first, by which it is known again."""
    assert recording.truth is not None  # all of the suite is simulated
    path = folder / f"{name}.tum"
    tum.write(path, recording.time, recording.truth)
    known = clear_relations(recording)
    if known is not None:
        relations.write(folder / f"{name}.relations", known)
    return file_hash(path)


def file_hash(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of every file in a folder, by its path in it."""
    return {
        file.relative_to(folder).as_posix(): file_hash(file)
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def card(entry: Entry, recording: Recording) -> str:
    """What a stranger needs to know of a recording."""
    purpose = {"test": "test: compare on it, never tune on it", "train": "train: learn from it"}
    lines = [
        f"# {entry.name}",
        "",
        f"Suite {suite().name}, {purpose[entry.split]}.",
        "",
        CATALOGUE[entry.scenario].summary,
        "",
        "| | |",
        "|---|---|",
        *(f"| {what} | {words} |" for what, words in _facts(entry, recording).items()),
        "",
        f"To answer: poses of the robot at the stamps of the scans, in any frame, as `{entry.name}.tum`",
        "(`stamp tx ty tz qx qy qz qw`, perhaps with a covariance behind).",
    ]
    return "\n".join(lines) + "\n"


RECKONING = {
    "ins": "an INS: position and yaw drift apart; increments of position hold in the world",
    "odometry": "odometry: increments hold in the body",
    "none": "none",
}
"""Source of a recording's dead reckoning → what it is."""


def _facts(entry: Entry, recording: Recording) -> dict[str, str]:
    """What a card states."""
    laser, angles = recording.laser, np.degrees(recording.angles)
    x, y, yaw = laser.T_robot_laser
    seconds = recording.time[-1] - recording.time[0]
    tilt = "" if recording.attitude is None else "; roll and pitch"
    apart = f"{np.diff(angles).mean():.3f}° apart"
    return {
        "what": f"{len(recording)} scans in {seconds:.0f} s, {recording.distance:.0f} m, simulated",
        "laser": f"{len(angles)} beams from {angles[0]:.1f}° to {angles[-1]:.1f}°, {apart}; "
        f"{laser.range_min:g} to {laser.range_max:g} m, noise {laser.sigma_range:.2g} m",
        "mount": f"x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(yaw):.2f}° in the robot's frame",
        "dead reckoning": RECKONING[recording.source] + tilt,
        "truth": "in the second folder: the robot's pose at every scan, exact; relations of the laser",
        "traps": suite().traps[entry.scenario],
        "licence": "CC0-1.0: made by a program, do with it what you like",
    }


def write_suite(folder: Path, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Write suite.json: the version, and of every recording what it is and what its files are."""
    content = {"schema": SCHEMA, "suite": suite().name, "entries": entries}
    dump(folder / SUITE_FILE, content)


def read_suite(folder: Path) -> dict[str, dict[str, Any]]:
    """What suite.json says of every recording. Raises `InputError` for a folder that is no suite of this
    version."""
    path = folder / SUITE_FILE
    if not path.is_file():
        raise InputError(
            f"{folder}: no suite, expected {SUITE_FILE} (python -m scenarios.suite export {folder})"
        )
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        found = content["schema"], content["suite"]
        entries = {name: _checked(name, entry) for name, entry in content["entries"].items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: expected what export wrote: {error}") from error
    if found != (SCHEMA, suite().name):
        raise InputError(
            f"{path}: suite {found[1]!r}, schema {found[0]!r}, expected {suite().name}, {SCHEMA}"
        )
    return entries


def _checked(name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """What is used of an entry of suite.json. Raises ``ValueError`` for a name that it has not."""
    if name not in {known.name for known in suite().entries}:
        raise ValueError(f"no recording of {suite().name}: {name!r}")
    hashes = {file: str(digest) for file, digest in entry["files"].items()}
    texts = {key: str(entry[key]) for key in ("fingerprint", "split", "scenario", "truth")}
    return {**texts, "frozen": bool(entry["frozen"]), "npz": hashes[f"{name}{SUFFIXES['npz']}"]}


def read_recording(folder: Path, name: str, expected: str) -> Recording:
    """A recording of the suite, without truth. Raises `InputError` where it is not the one of which the
    SHA-256 is ``expected``."""
    path = folder / name / f"{name}{SUFFIXES['npz']}"
    try:
        if path.is_file() and file_hash(path) != expected:
            raise FormatError("changed since the suite was exported, expected the file as it was", path)
        return load(path)
    except FormatError as error:
        raise InputError(str(error)) from error


def read_truth(folder: Path, name: str, recording: Recording, expected: str) -> Array:
    """True poses ``(N, 3)`` of a recording. Raises `InputError` where there are none, and where they are not
    those of which the SHA-256 is ``expected``."""
    path = folder / f"{name}.tum"
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected the truth of {name}: was it withheld?")
    if file_hash(path) != expected:
        raise InputError(f"{path}: changed since the suite was exported, expected the truth as it was")
    time, poses = tum.read(path)
    if len(time) != len(recording):
        raise InputError(f"{path}: {len(time)} poses, expected one for each of {len(recording)} scans")
    return poses
