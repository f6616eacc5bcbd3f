"""python -m scenarios.peers list|install NAME|run NAME RECORDING: systems of others, scored beside ours."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.peers import PEERS, Peer, Settings
from slam.cli import POSE, InputError, Pose, main, nearest

if TYPE_CHECKING:
    from slam.recording import Recording

COMMAND = "scenarios.peers"
ALL = "all"


@dataclass(frozen=True)
class Options:
    """Run systems of others on a recording and score them as python -m scenarios.score does.

    Each runs in a process of its own, with the settings of its authors (default) or with one set that was
    found on the train seeds of the suite (tuned), and is told neither truth nor relations. One that is not
    installed is skipped in one line.
    """

    what: Positional[Annotated[Literal["list", "install", "run"], arg(help_behavior_hint="")]]
    """list: what there is; install: install one; run: run it."""
    name: Positional[Annotated[str, arg(metavar="NAME,…|all", help_behavior_hint="")]] = ""
    """Which, with commas between."""
    recording: Positional[Annotated[str, arg(metavar="RECORDING", help_behavior_hint="")]] = ""
    """A scenario (with --seed), a log, or the folder of a suite's recording."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """Which of a scenario's drives."""
    settings: Literal["default", "tuned", "both"] = "default"
    """With which settings."""
    methods: Annotated[str, arg(metavar="A,B,…", help_behavior_hint="")] = ""
    """Methods of ours to run beside them, separated by commas."""
    seconds: Annotated[float, arg(metavar="S")] = 600.0
    """Wall time that each may take."""
    gigabytes: Annotated[float, arg(metavar="GB")] = 8.0
    """Memory that each may take."""
    relations: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """File of true relative poses to score a log against."""
    laser_mount: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Laser in the robot's frame in m and rad, where a log does not tell."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("runs")
    """Folder that the run's folder is put into."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


def run(options: Options) -> None:
    """List, install, or run and score. Raises `InputError`."""
    if options.what == "list":
        for peer in PEERS.values():
            print(f"{peer.name:<18} {state(peer):<14} {peer.summary}")
        return
    names = list(PEERS) if options.name == ALL else [name for name in options.name.split(",") if name]
    for name in names:
        if name not in PEERS:
            raise InputError(f"unknown peer {name!r}: {nearest(name, [*PEERS, ALL])}")
    if not names:
        raise InputError(f"expected a name, one of {', '.join(PEERS)}, or {ALL}")
    if options.what == "install":
        install([PEERS[name] for name in names])
    else:
        run_and_score(options, [PEERS[name] for name in names])


def state(peer: Peer) -> str:
    """The version that is here, or that it is not."""
    return peer.version() if peer.installed() else "not installed"


def install(peers: Sequence[Peer]) -> None:
    """Install with pip what pip installs; of the others print the command, for it wants an administrator."""
    for peer in peers:
        program, *rest = shlex.split(peer.install)
        if peer.installed():
            print(f"{peer.name}: installed, {peer.version()}")
        elif program != "pip":
            print(f"{peer.name}: {peer.install}")
        elif subprocess.run([sys.executable, "-m", "pip", *rest], check=False).returncode:
            raise InputError(f"{peer.name}: {peer.install} failed")


def run_and_score(options: Options, peers: Sequence[Peer]) -> None:
    """Every peer that is here with its settings, then the score of all. Raises `InputError` where a peer has
    no answer and nothing else can be scored."""
    if not options.recording:
        raise InputError("expected a recording: a scenario, a log, or a suite's folder")
    if not (options.seconds > 0.0 and options.gigabytes > 0.0):
        raise InputError("--seconds, --gigabytes: expected more than 0")
    here = [peer for peer in peers if peer.installed()]
    for peer in peers:
        if peer not in here:
            print(f"{peer.name} is not installed, skipped: {peer.install}", file=sys.stderr)
    if not here:
        return

    import tempfile

    from scenarios.peers.process import Limits, solve
    from scenarios.score import __main__ as score
    from slam.formats import tum

    wanted: tuple[Settings, ...] = ("default", "tuned")
    recording, limits = obtain(options), Limits(options.seconds, options.gigabytes)
    with tempfile.TemporaryDirectory() as folder:
        paths, origins = [], {}
        for peer in here:
            for settings in wanted if options.settings == "both" else (options.settings,):
                name = peer.name if settings == "default" else f"{peer.name} ({settings})"
                print(f"{name} …", file=sys.stderr)
                found = solve(peer, recording, settings, limits)
                if isinstance(found, str):
                    print(f"{name} {found}", file=sys.stderr)
                    continue
                paths.append(Path(folder) / f"{name}.tum")
                tum.write(paths[-1], found.trajectory.time, found.trajectory.poses)
                origins[name] = score.Origin(peer.version(), found.wall_s, found.peak_mb)
        if not paths:
            raise InputError("no peer has an answer")
        asked = score.Options(
            options.recording,
            tuple(paths),
            options.seed,
            options.methods,
            poses_of="robot",
            out=options.out,
            format=options.format,
            relations=options.relations,
            laser_mount=options.laser_mount,
        )
        score.run(asked, origins, COMMAND)


def obtain(options: Options) -> Recording:
    """The recording as score will take it: where nobody states the laser's mount, with the one that the drive
    tells. Raises `InputError`."""
    from rich.console import Console

    from scenarios import run as road
    from scenarios.score.truth import entry_file
    from scenarios.stages import Stages

    asked = road.Options(
        recording=entry_file(options.recording),
        seed=options.seed,
        relations=options.relations,
        laser_mount=options.laser_mount,
    )
    road.checked(asked)
    return road.obtain(asked, road.configure(asked), Stages(Console(stderr=True, quiet=True))).recording


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
