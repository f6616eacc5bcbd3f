"""A drive in the room, as a log, and answers to it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from slam.formats import recording_npz
from slam.recording import Recording
from slam.se2 import Array


@pytest.fixture(scope="session")
def turning(record: Callable[..., Recording], room: Array, curve: Callable[..., Array]) -> Recording:
    """Forty scans of a turn in the room, with truth."""
    truth = curve(40)
    return record(room, truth, dead_reckoning=truth * [1.05, 1.0, 1.0])


@pytest.fixture
def log(turning: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The drive as a file in a folder to be in; runs draw no figures."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("scenarios.report.page.run_specs", lambda *_: [])
    recording_npz.write("room.npz", turning)
    return Path("room.npz")
