"""What a version of the suite consists of, and what tells its recordings from all others."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import yaml

from scenarios.options import parse_names

if TYPE_CHECKING:
    from slam.recording import Recording

VERSION = "v1"
Split = Literal["test", "train"]
SPLITS: tuple[Split, ...] = ("test", "train")


@dataclass(frozen=True)
class Entry:
    """A recording of the suite: drive ``seed`` through a ``scenario``, to be compared on or to learn from."""

    scenario: str
    seed: int
    split: Split

    @property
    def name(self) -> str:
        """What its files are called."""
        return f"{self.scenario}-{self.seed}"


@dataclass(frozen=True)
class Suite:
    """The entries of a version, and the trap in each scenario; ``frozen``: the fingerprint of each recording
    and its truth, ``made_with`` that processor and those packages."""

    name: str
    entries: tuple[Entry, ...]
    traps: Mapping[str, str]
    frozen: Mapping[str, str]
    made_with: Mapping[str, str]


@cache
def suite() -> Suite:
    """The suite of this version."""
    here = Path(__file__).parent
    content = yaml.safe_load((here / f"{VERSION}.yaml").read_text(encoding="utf-8"))
    entries = tuple(
        Entry(scenario, seed, split)
        for split in SPLITS
        for scenario in content["scenarios"]
        for seed in content["seeds"][split]
    )
    lines = (here / f"{VERSION}.sha256").read_text(encoding="utf-8").splitlines()
    frozen = {name: digest for digest, name in (line.split() for line in lines)}
    return Suite(VERSION, entries, content["traps"], frozen, content["made_with"])


def chosen(split: str, scenarios: str) -> list[Entry]:
    """The entries of a split, or of "all", of ``scenarios`` with commas between; of all where it is empty.
    Raises `InputError` for a scenario that the suite does not have."""
    known = list(dict.fromkeys(entry.scenario for entry in suite().entries))
    wanted = parse_names(scenarios, known, "scenario") if scenarios else known
    return [e for e in suite().entries if e.scenario in wanted and split in (e.split, "all")]


def fingerprint(recording: Recording) -> str:
    """SHA-256 of every number of a recording and of its truth."""
    import numpy as np

    laser, odometry = recording.laser, recording.odometry
    rates = () if odometry is None else (odometry.time, odometry.poses, odometry.scan_row)
    parts = (
        np.array([laser.range_min, laser.range_max, laser.sigma_range]),
        laser.T_robot_laser,
        recording.time,
        recording.ranges,
        recording.angles,
        recording.dead_reckoning,
        recording.attitude,
        recording.truth,
        *rates,
    )
    whole = hashlib.sha256(recording.source.encode())
    for part in parts:
        if part is not None:
            whole.update(np.ascontiguousarray(part, dtype=np.float64).tobytes())
    return whole.hexdigest()
