"""python -m scenarios.run NAME | LOG: one recording, every method, one table, one folder to look at."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.catalogue import CATALOGUE
from scenarios.cli import BadInput, main, nearest
from scenarios.methods import METHODS

if TYPE_CHECKING:
    from scenarios.estimate import Estimate
    from scenarios.evaluation import Metric
    from scenarios.methods.config import MethodConfig
    from scenarios.stages import Stages
    from slam.recording import Recording

COMMAND = "scenarios.run"


@dataclass(frozen=True)
class Options:
    """Simulate a scenario, or read a robot's log, run every method on it and score them.

    Prints the table of metrics and writes a folder with maps, trajectories and report.html.
    """

    recording: Positional[Annotated[str, arg(metavar="NAME|LOG")]] = ""
    """A scenario (see --list), or a log: USARSim, CARMEN .log or .log.gz, recording.npz."""
    list: Annotated[bool, arg(help_behavior_hint="")] = False
    """Print the scenarios and why each exists."""
    seed: int = 0
    """Which of a scenario's drives to simulate."""
    methods: str = ",".join(METHODS)
    """Methods to run, separated by commas."""
    out: Path = Path("runs")
    """Folder that the run's folder is put into."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    relations: Path | None = None
    """File of true relative poses (Kümmerle et al. 2009) to score a log against."""
    laser_mount: tuple[float, float, float] | None = None
    """Laser in the robot's frame, x y yaw in m and rad, where a log does not tell."""


def run(options: Options) -> None:
    """The whole road: recording → estimates → metrics → run folder → table."""
    if options.list:
        print_catalogue()
        return
    from rich.console import Console

    from scenarios import evaluation, run_folder
    from scenarios.methods.config import MethodConfig
    from scenarios.stages import Stages

    methods, simulated = checked(options)
    config, stages = MethodConfig(), Stages(Console(stderr=True))
    with run_folder.prepare(options.out, name_of(options, simulated)) as folder:
        tell_of_compilation(stages)
        with stages.stage("simulate" if simulated else "read"):
            recording = obtain(options, simulated)
        estimates = estimate(recording, methods, config, stages)
        others = [] if simulated else published(options, recording)
        with stages.stage("evaluate"):
            metrics = evaluation.evaluate(recording, [*estimates, *others])
        metrics += costs(metrics, recording, stages)
        with stages.stage("report"):
            run_folder.write(folder, recording, [*estimates, *others], metrics, facts(options, config, stages))
        run_folder.publish(folder, stages.costs)
    show(options, recording, metrics, folder.final)


def checked(options: Options) -> tuple[list[str], bool]:
    """The methods to run, and whether the recording is simulated. Raises `BadInput`."""
    from scenarios.source import is_scenario

    if not options.recording:
        raise BadInput(f"expected a scenario or a log; scenarios: {', '.join(CATALOGUE)}")
    if options.seed < 0:
        raise BadInput(f"--seed: expected 0 or more, got {options.seed}")
    methods = [name.strip() for name in options.methods.split(",") if name.strip()]
    for name in methods:
        if name not in METHODS:
            raise BadInput(f"unknown method {name!r}: {nearest(name, METHODS)}")
    if not methods:
        raise BadInput(f"--methods: expected one or more of {', '.join(METHODS)}")
    simulated = is_scenario(options.recording)
    if simulated and (options.relations or options.laser_mount):
        raise BadInput("--relations and --laser-mount are for logs; a scenario knows its own truth")
    return list(dict.fromkeys(methods)), simulated


def name_of(options: Options, simulated: bool) -> str:
    """Name of the run's folder."""
    name = options.recording if simulated else Path(options.recording).name.split(".")[0]
    return f"{name or 'recording'}-seed{options.seed}"


def obtain(options: Options, simulated: bool) -> Recording:
    """The recording, simulated or read."""
    from scenarios import source

    if simulated:
        return source.simulated(options.recording, options.seed)
    return source.logged(Path(options.recording), options.relations, options.laser_mount)


def estimate(
    recording: Recording, methods: list[str], config: MethodConfig, stages: Stages
) -> list[Estimate]:
    """Every method's answer, in the order asked for."""
    estimates = []
    for name in methods:
        with stages.stage(name):
            estimates.append(METHODS[name](recording, config))
    return estimates


def published(options: Options, recording: Recording) -> list[Estimate]:
    """What other systems answered for this log, where their answers lie beside it."""
    from scenarios.estimate import Estimate
    from scenarios.source import peers
    from slam.formats import peer

    found = peers(Path(options.recording))
    return [Estimate(other.name, peer.read(other.path, len(recording))) for other in found]


def costs(metrics: list[Metric], recording: Recording, stages: Stages) -> list[Metric]:
    """Wall time and memory of every method that ran here."""
    from scenarios.evaluation import cost

    ran = [name for name in dict.fromkeys(metric.method for metric in metrics) if name in stages.costs]
    return [m for n in ran for m in cost(n, stages.costs[n].wall_s, len(recording), stages.costs[n].peak_mb)]


def facts(options: Options, config: MethodConfig, stages: Stages) -> dict[str, object]:
    """What made the run: the command line, every parameter, versions, and the cost of each stage so far."""
    from scenarios.environment import environment

    return {
        "command": " ".join(["python -m", COMMAND, *sys.argv[1:]]),
        "seed": options.seed,
        "config": config,
        "environment": environment(stages.costs),
    }


def tell_of_compilation(stages: Stages) -> None:
    """The first run on a machine compiles the kernels; nobody should wonder why it takes so long."""
    root = Path(__file__).resolve().parents[1]
    if not any(root.glob("slam/**/__pycache__/*.nbi")):
        stages.console.print("first run: compiling the kernels takes about a minute, once")


def show(options: Options, recording: Recording, metrics: list[Metric], folder: Path) -> None:
    """The results on stdout."""
    from scenarios.report.table import tabulate, to_rich
    from scenarios.run_folder import metrics_json

    if options.format == "json":
        print(metrics_json(recording, options.seed, metrics))
        return
    from rich.console import Console

    title = f"{recording.name}: {len(recording)} scans, {recording.distance:.0f} m"
    console = Console()
    console.print(to_rich(tabulate(metrics), title))
    console.print(f"[bold]{folder / 'report.html'}[/bold]", highlight=False, soft_wrap=True)


def print_catalogue() -> None:
    """Every scenario and why it exists."""
    for scenario in CATALOGUE.values():
        print(f"{scenario.name:<14} {scenario.summary}")


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
