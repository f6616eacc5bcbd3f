"""python -m scenarios.run NAME | LOG: one recording, every method, one table, one folder to look at."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios.catalogue import CATALOGUE
from scenarios.cli import POSE, BadInput, Pose, main, nearest
from scenarios.methods import FAIR, METHODS, REHEARSED_AS

if TYPE_CHECKING:
    from scenarios.estimate import Estimate
    from scenarios.evaluation import Metric
    from scenarios.methods.config import MethodConfig
    from scenarios.run_folder import Run
    from scenarios.source import Source
    from scenarios.stages import Stages
    from slam.recording import Recording

COMMAND = "scenarios.run"


@dataclass(frozen=True)
class Options:
    """Simulate a scenario or a drive through a ROS map, or read a robot's log; run every method and score it.

    Prints the table of metrics and writes a folder with maps, trajectories and report.html.
    """

    recording: Positional[Annotated[str, arg(metavar="NAME|LOG", help_behavior_hint="")]] = ""
    """A scenario (see --list), a ROS map (.yaml) to drive through, or a log: USARSim, CARMEN .log or .log.gz,
    ROS 2 bag, recording.npz."""
    list: Annotated[bool, arg(help_behavior_hint="")] = False
    """Print the scenarios and why each exists."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """Which of a scenario's drives to simulate."""
    methods: Annotated[str, arg(metavar="A,B,…")] = ",".join(FAIR)
    """Methods to run, separated by commas; "oracle", which is told the truth, only where it is named."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("runs")
    """Folder that the run's folder is put into."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    relations: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """File of true relative poses (Kümmerle et al. 2009) to score a log against."""
    laser_mount: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Laser in the robot's frame in m and rad, where a log does not tell."""
    dead_reckoning: Annotated[
        Literal["ins", "odometry"] | None, arg(metavar="ins|odometry", help_behavior_hint="")
    ] = None
    """What a simulated robot reckons with, where it shall not be what the scenario has."""
    start: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Where a drive through a ROS map begins, in m and rad; drawn where it is not given."""


def run(options: Options) -> None:
    """The whole road: recording → estimates → metrics → run folder → table."""
    if options.list:
        print_catalogue()
        return
    methods, name = checked(options)

    from rich.console import Console

    from scenarios import run_folder
    from scenarios.evaluation import evaluate
    from scenarios.methods.config import MethodConfig
    from scenarios.stages import Stages

    run_folder.check(options.out, name)
    config, stages = MethodConfig(), Stages(Console(stderr=True))
    source = obtain(options, stages)
    estimates = [*estimate(source.recording, methods, config, stages), *source.published]
    with stages.stage("evaluate"):
        metrics = evaluate(source.recording, estimates) + costs(methods, source.recording, stages)
    result = described(options, config, source, estimates, metrics)
    with run_folder.prepare(options.out, name) as folder:
        with stages.stage("report"):
            run_folder.write(folder, result)
        run_folder.publish(folder, {**result.environment, "stages": stages.costs})
    show(result, options.format, folder.final)


def checked(options: Options) -> tuple[list[str], str]:
    """The methods to run, and the name of the run's folder. Raises `BadInput`."""
    from scenarios.source import is_map, is_scenario

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
    simulates = is_scenario(options.recording)
    if simulates and (options.relations or options.laser_mount):
        raise BadInput("--relations and --laser-mount are for logs: a scenario knows its own truth")
    if options.dead_reckoning and not simulates:
        raise BadInput("--dead-reckoning is for simulated robots: a log has what it has")
    if options.start and not (simulates and is_map(options.recording)):
        raise BadInput("--start is for ROS maps: scenarios and logs have a start of their own")
    name = Path(options.recording).name.split(".")[0]
    return list(dict.fromkeys(methods)), f"{name}-seed{options.seed}"


def obtain(options: Options, stages: Stages) -> Source:
    """The recording, simulated or read."""
    from scenarios import source

    if source.is_scenario(options.recording):
        tell_of_compilation(stages)
        with stages.stage("simulate"):
            found = source.simulated(options.recording, options.seed, options.start, options.dead_reckoning)
        stages.console.print(f"the drive ended: {found.settings['ending']}", style="dim", highlight=False)
        return found
    with stages.stage("read"):
        found = source.logged(Path(options.recording), options.relations, options.laser_mount)
    tell_of_compilation(stages)
    return found


def tell_of_compilation(stages: Stages) -> None:
    """The first run on a machine compiles the kernels; nobody should wonder why it takes so long."""
    root = Path(__file__).resolve().parents[1]
    if not any(root.glob("slam/**/__pycache__/*.nbi")):
        stages.console.print("first run: compiling the kernels takes about a minute, once")


def estimate(
    recording: Recording, methods: list[str], config: MethodConfig, stages: Stages
) -> list[Estimate]:
    """Every method's answer, in the order asked for; compiling and loading kernels is on nobody's bill."""
    from scenarios.rehearsal import rehearsal

    with stages.stage("rehearse"):
        short = rehearsal(recording)
        for name in methods:
            METHODS[REHEARSED_AS.get(name, name)](short, config)
    estimates = []
    for name in methods:
        with stages.stage(name):
            estimates.append(METHODS[name](recording, config))
    return estimates


def costs(methods: list[str], recording: Recording, stages: Stages) -> list[Metric]:
    """Wall time and memory of every method that ran here."""
    from scenarios.evaluation import cost

    paid = [(name, stages.costs[name]) for name in methods]
    return [metric for name, c in paid for metric in cost(name, c.wall_s, len(recording), c.peak_mb)]


def described(
    options: Options, config: MethodConfig, source: Source, estimates: list[Estimate], metrics: list[Metric]
) -> Run:
    """The run with what it takes to make it again: the command line, every parameter, and the versions."""
    from scenarios.environment import environment
    from scenarios.run_folder import Run

    asked = {
        "command": shlex.join(["python", "-m", COMMAND, *sys.argv[1:]]),
        "options": asdict(options),
        "scenario": source.settings,
        "methods": config,
    }
    return Run(asked, environment(), options.seed, source.recording, estimates, metrics, source.simulated)


def show(result: Run, form: str, folder: Path) -> None:
    """The results on stdout."""
    from scenarios.report.table import print_table, tabulate
    from scenarios.run_folder.metrics import metrics_json

    if form == "json":
        print(metrics_json(result))
        return
    recording = result.recording
    print_table(
        tabulate(result.metrics), f"{recording.name}: {len(recording)} scans, {recording.distance:.0f} m"
    )
    print(folder / "report.html")


def print_catalogue() -> None:
    """Every scenario: its size, the length of a drive, and why it exists."""
    for scenario in CATALOGUE.values():
        across, deep = scenario.size_m
        size, drive = f"{across:.0f} × {deep:.0f} m", f"{scenario.drive_m:.0f} m"
        print(f"{scenario.name:<13} {size:>11} {drive:>6}  {scenario.summary}")


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
