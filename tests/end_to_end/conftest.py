"""Commands as a user runs them, in this process: starting Python anew for each would take a minute."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

SCANS = slice(300, 450)
"""A stretch of the hospital that takes in a room."""


@dataclass(frozen=True)
class Finished:
    """Exit code and output of a command."""

    code: int
    stdout: str
    stderr: str


Command = Callable[..., Finished]


def run_command(*words: object) -> Finished:
    """``python -m scenarios.run WORDS``."""
    from scenarios.cli import main
    from scenarios.run import COMMAND, Options, run

    stdout, stderr = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["run.py", *map(str, words)])
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            code = main(Options, COMMAND, run)
    return Finished(code, stdout.getvalue(), stderr.getvalue())


@pytest.fixture(scope="session")
def command() -> Command:
    return run_command


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording.npz: part of a drive through the hospital."""
    from scenarios.catalogue import CATALOGUE
    from sim.record import simulate
    from slam.formats import recording_npz

    whole = simulate(CATALOGUE["hospital"], 0).recording
    arrays = ("time", "ranges", "dead_reckoning", "attitude", "truth")
    part = {name: getattr(whole, name)[SCANS] for name in arrays}
    path = tmp_path_factory.mktemp("drive") / "drive.npz"
    recording_npz.write(path, replace(whole, name="part of the hospital", **part))
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
