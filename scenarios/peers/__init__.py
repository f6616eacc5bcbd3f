"""Systems of others, run on our recordings: each in a process of its own, with its authors' settings."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Literal

Settings = Literal["default", "tuned"]


@dataclass(frozen=True)
class Peer:
    """A system of others."""

    name: str
    """What it is called everywhere."""
    summary: str
    """What it does, and under which licence."""
    solve: str
    """``module:function`` that takes a recording, the settings' name and a folder to work in, and returns the
    poses (N, 3) of the robot."""
    installed: Callable[[], bool]
    """Whether it is here."""
    install: str
    """The command that installs it."""
    version: Callable[[], str]
    """Which version is here."""
    tuned: str
    """What is set otherwise in ``tuned``, and on what it was found."""


def _package(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def _mrpt() -> str:
    """MRPT's version, which its programs print when they begin."""
    told = subprocess.run(["icp-slam"], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=20)
    found = re.search(r"MRPT (\d[\w.]*)", told.stdout + told.stderr)
    return found[1] if found else "unknown"


PEERS: dict[str, Peer] = {
    peer.name: peer
    for peer in (
        Peer(
            "mrpt-icp-slam",
            "MRPT's ICP against a map of points; BSD",
            "scenarios.peers.mrpt:solve",
            lambda: bool(shutil.which("icp-slam") and shutil.which("carmen2rawlog")),
            "sudo apt install mrpt-apps",
            _mrpt,
            "Levenberg-Marquardt, all points, map points every 0.4 m and 20°; train seeds of the suite",
        ),
        Peer(
            "kiss-icp",
            "KISS-ICP: odometry by the laser alone, made for lasers in space (Vizzo et al. 2023); MIT",
            "scenarios.peers.kiss:solve",
            lambda: find_spec("kiss_icp") is not None,
            "pip install kiss-icp",
            lambda: _package("kiss-icp"),
            "voxels of 0.1 m, thresholds that fit a robot of walking pace; train seeds of the suite",
        ),
        Peer(
            "karto-scanmatcher",
            "OpenKarto's correlative scan matcher against the last scans, from dead reckoning; LGPL",
            "scenarios.peers.karto:solve",
            lambda: find_spec("karto_scanmatcher") is not None,
            "pip install karto-scanmatcher",
            lambda: _package("karto-scanmatcher"),
            "twenty scans instead of ten, less held to dead reckoning; train seeds of the suite",
        ),
    )
}
"""Name → peer."""
