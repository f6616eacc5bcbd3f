"""A peer run in a process of its own, blind, with a limit of time and memory."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.peers import Peer, Settings
from scenarios.peers.worker import POSES, RECORDING
from slam.formats import recording_npz
from slam.recording import Recording
from slam.trajectory import Trajectory


@dataclass(frozen=True)
class Limits:
    """What a peer may take: wall time [s] and memory [GB]."""

    seconds: float
    gigabytes: float


@dataclass(frozen=True)
class Solved:
    """A peer's answer, and what it cost: wall time [s], peak memory [MB]."""

    trajectory: Trajectory
    wall_s: float
    peak_mb: float


def solve(peer: Peer, recording: Recording, settings: Settings, limits: Limits) -> Solved | str:
    """The peer's answer to a recording whose truth it is not told, or why it has none, in one line."""
    with tempfile.TemporaryDirectory() as folder:
        blind = replace(recording, truth=None, relations=None)
        recording_npz.write(Path(folder) / RECORDING, blind)
        command = [sys.executable, "-m", "scenarios.peers.worker", peer.name, settings, folder]
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,  # so that its own programs end with it
            preexec_fn=lambda: _limit(limits),
        )
        try:
            _, told = process.communicate(timeout=limits.seconds)
        except subprocess.TimeoutExpired:
            _end(process)
            return f"took more than {limits.seconds:g} s"
        except BaseException:
            _end(process)
            raise
        if process.returncode:
            last = told.decode(errors="replace").strip().splitlines()[-1:] or ["no word why"]
            return f"ended with code {process.returncode}: {last[0][:200]}"
        with np.load(Path(folder) / POSES, allow_pickle=False) as arrays:
            if not np.all(np.isfinite(arrays["poses"])):
                return "has a pose that is not finite"
            found = Trajectory(arrays["time"], arrays["poses"], body="robot")
            return Solved(found, float(arrays["wall_s"]), float(arrays["peak_mb"]))


def _limit(limits: Limits) -> None:
    most = int(1e9 * limits.gigabytes)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _end(process: subprocess.Popen[bytes]) -> None:
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
