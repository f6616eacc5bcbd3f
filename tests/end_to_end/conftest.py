"""Commands as a user runs them, in this process: starting Python anew for each would take a minute."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from scenarios.catalogue import CATALOGUE

if TYPE_CHECKING:
    from sim.record import Setup

WALK = 20.0
"""Metres."""


@dataclass(frozen=True)
class Finished:
    """Exit code and output of a command."""

    code: int
    stdout: str
    stderr: str


Command = Callable[..., Finished]


def run_command(*words: object) -> Finished:
    """``python -m scenarios.run WORDS``."""
    from scenarios.run import COMMAND, Options, run, take
    from slam.cli import main

    stdout, stderr = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["run.py", *map(str, words)])
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            code = main(Options, COMMAND, run, take)
    return Finished(code, stdout.getvalue(), stderr.getvalue())


@pytest.fixture(scope="session")
def command() -> Command:
    return run_command


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs draw no figures, on which they spend three quarters of their time."""
    monkeypatch.setattr("scenarios.report.page.run_specs", lambda *_: [])


@dataclass(frozen=True)
class Walk:
    """A scenario: the first metres of the hospital's route."""

    name: str = "walk"
    summary: str = "A short walk."

    def build(self, rng: np.random.Generator) -> Setup:
        setup = CATALOGUE["hospital"].build(rng)
        walked = np.cumsum(np.hypot(*np.diff(setup.waypoints, axis=0, prepend=[setup.start[:2]]).T))
        return replace(setup, waypoints=setup.waypoints[walked < WALK])


@pytest.fixture
def walk(monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a scenario in the catalogue that is simulated in no time."""
    monkeypatch.setitem(CATALOGUE, "walk", Walk())
    return "walk"


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording.npz of a walk through the hospital."""
    from sim.record import simulate
    from slam.formats import recording_npz

    path = tmp_path_factory.mktemp("drive") / "drive.npz"
    recording_npz.write(path, simulate(Walk(), 0).recording)
    return path


@dataclass(frozen=True)
class Done:
    """A run of all methods on the drive: what the command printed, and the run's folder."""

    finished: Finished
    folder: Path


@pytest.fixture(scope="session")
def done(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Done:
    out = tmp_path_factory.mktemp("runs")
    return Done(run_command(drive, "--out", out), out / "drive-seed0")
