"""Pairs of scans in the building, and logs with known answers, for the tests of the matcher's bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.bench.matching import cost
from scenarios.bench.matching import pairs as making
from slam.formats import recording_npz


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
