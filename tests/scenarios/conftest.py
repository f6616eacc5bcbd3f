"""Studies as a user runs them, and what the tests of the matcher's bench match: pairs, and logs with known
answers."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from scenarios.bench.matching import cost
from scenarios.bench.matching import pairs as making
from scenarios.catalogue import CATALOGUE
from scenarios.sweep.version import code_version
from sim.record import Buildable, Setup
from slam.formats import recording_npz


@dataclass(frozen=True)
class Begun:
    """A scenario whose drive is broken off after some seconds."""

    whole: Buildable
    seconds: float

    @property
    def name(self) -> str:
        return self.whole.name

    def build(self, rng: np.random.Generator) -> Setup:
        setup = self.whole.build(rng)
        return replace(setup, driver=replace(setup.driver, time_limit=self.seconds))


@pytest.fixture(scope="session")
def begun() -> Callable[[str, float], Begun]:
    """The beginning of a scenario of the catalogue: its name and how many seconds are driven."""
    whole = dict(CATALOGUE)
    return lambda name, seconds: Begun(whole[name], seconds)


@dataclass(frozen=True)
class Finished:
    """Exit code and output of a command."""

    code: int
    stdout: str
    stderr: str


@pytest.fixture
def ablate(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Finished]:
    """``python -m scenarios.ablate WORDS``, in this process: starting Python anew takes longer."""
    from scenarios.ablate.__main__ import run

    code_version.cache_clear()  # as a process that has just been started finds it
    monkeypatch.setattr(sys, "argv", ["ablate"])

    def ablate(*words: object) -> Finished:
        code = run([*map(str, words)])
        return Finished(code, *capsys.readouterr())

    return ablate


@pytest.fixture(scope="module")
def built() -> making.PairSet:
    """A few simulated pairs."""
    return making.simulated(12, np.random.default_rng(100))


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A data folder whose logs the project made: a drive in circles, standing still at times."""
    data = tmp_path_factory.mktemp("data")
    drive = cost.round_and_round(40, np.random.default_rng(0))
    poses = drive.dead_reckoning.round(2)
    poses[20:24] = poses[20]
    attitude = np.zeros((40, 2))
    attitude[30:, 0] = np.radians(11.0)  # fell over
    for name, recording in (
        (making.INTEL, drive),
        (making.EXPERIMENT_1, replace(drive, truth=poses, attitude=attitude)),
    ):
        (data / name).parent.mkdir(parents=True)
        recording_npz.write(data / name, recording)
    rows = np.column_stack([drive.time, drive.dead_reckoning])
    np.savetxt(data / making.INTEL_POSES, rows)
    return data
