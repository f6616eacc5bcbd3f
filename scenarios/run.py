"""python -m scenarios.run NAME | LOG: one recording, every method, one table, one folder to look at."""

from __future__ import annotations

import math
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import Positional, arg

from scenarios.catalogue import CATALOGUE
from scenarios.corruptions import Corrupt, corrupted, name_part, parse_corruptions, told
from scenarios.corruptions import table as table_of_corruptions
from scenarios.methods import COMPARED, METHODS, ONLINE, load_kernels
from scenarios.options import check_seed, parse_names
from slam.cli import POSE, InputError, Pose, main

if TYPE_CHECKING:
    from scenarios.evaluation.metric import Metric
    from scenarios.methods.config import MethodConfig
    from scenarios.run_folder.write import Run
    from scenarios.source import Source
    from scenarios.stages import Stages
    from slam.recording import Recording
    from stitch.mapping.estimate import Estimate, NoEstimate

COMMAND = "scenarios.run"
Words = list[str]


@dataclass(frozen=True)
class Options:
    """Simulate a scenario or a drive through a ROS map, or read a robot's log; run every method and score it.

    Prints the table of metrics and writes a folder with maps, trajectories and report.html.
    """

    recording: Positional[Annotated[str, arg(metavar="NAME|LOG", help_behavior_hint="")]] = ""
    """A scenario (see --list), a ROS map (.yaml) to drive through, or a log: USARSim or CARMEN (.log, or
    compressed: .gz, .bz2, .xz, .zst), ROS bag, recording.npz."""
    list: Annotated[bool, arg(help_behavior_hint="")] = False
    """Print the scenarios and why each exists."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """Which of a scenario's drives to simulate."""
    methods: Annotated[str, arg(metavar="A,B,…")] = ",".join(COMPARED)
    """Methods to run, separated by commas; "oracle", which is told the truth, only where it is named."""
    online: Annotated[bool, arg(help_behavior_hint="")] = False
    """Also run slamstitch scan by scan, as on a robot, and measure the latency of each scan."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("runs")
    """Folder that the run's folder is put into."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    view: Annotated[bool, arg(help_behavior_hint="")] = False
    """Open the run in Rerun when it is done; needs the extra [view]."""
    relations: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """File of true relative poses (Kümmerle et al. 2009) to score a log against."""
    laser_mount: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Laser in the robot's frame in m and rad, where a log does not tell; without, it is estimated from the
    drive, if there is odometry and no truth."""
    topic: Annotated[str, arg(metavar="TOPIC", help_behavior_hint="")] = ""
    """Which of a ROS bag's lasers to read, where it is not /scan or the first by name."""
    odometry: Annotated[str, arg(metavar="TOPIC", help_behavior_hint="")] = ""
    """Which odometry of a ROS bag, where it is not the first that moves: a topic, or /tf:FRAME."""
    field_of_view: Annotated[float | None, arg(metavar="DEG", help_behavior_hint="")] = None
    """What the laser spans, where a text log does not tell; without, what makes one scan fit the next."""
    dead_reckoning: Annotated[
        Literal["ins", "odometry"] | None, arg(metavar="ins|odometry", help_behavior_hint="")
    ] = None
    """What a simulated robot reckons with, where it shall not be what the scenario has."""
    no_dead_reckoning: Annotated[bool, arg(help_behavior_hint="")] = False
    """Take no notice of the dead reckoning: the laser alone tells how the robot moved. Methods that rest on
    it have no answer then."""
    corrupt: Corrupt = ()
    """Spoil the recording before anything else is done with it, as odometry.frozen=3; may be given several
    times, in this order. --list-corruptions tells which there are; --seed also draws what is spoilt."""
    list_corruptions: Annotated[bool, arg(help_behavior_hint="")] = False
    """Print every corruption with what it does, the meaning of its severity, its default and its range."""
    matcher: Annotated[str, arg(metavar="NAME|MODULE:FUNCTION", help_behavior_hint="")] = ""
    """Scan matcher of slamstitch's front end: plicp (its own), wsm, icp, or a function of your module."""
    config: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """Settings to start from: a run's config.json, or a part of one. Single ones are set by their key, as
    --slam.loops.length 4; --list-settings prints all of them."""
    list_settings: Annotated[bool, arg(help_behavior_hint="")] = False
    """Print every setting with its value and meaning."""
    settings: Annotated[Mapping[str, Sequence[str]], tyro.conf.Suppress] = field(default_factory=dict)
    start: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Where a drive through a ROS map begins, in m and rad; drawn where it is not given."""


def run(options: Options) -> None:
    """The whole road: recording → estimates → metrics → run folder → table."""
    if options.list:
        print_catalogue()
        return
    if options.list_settings:
        print_settings(options)
        return
    if options.list_corruptions:
        table_of_corruptions().print()
        return
    methods, name = checked(options)
    if options.view:
        from scenarios.report import view

        view.check()

    from rich.console import Console

    from scenarios.evaluation import evaluate
    from scenarios.run_folder import directory
    from scenarios.run_folder.write import write_run
    from scenarios.stages import Stages

    mark = options.recording if options.recording in CATALOGUE else directory.fingerprint(options.recording)
    name = directory.vacant_name(options.out, name, mark)
    directory.check(options.out, name)
    config, stages = configure(options), Stages(Console(stderr=True))
    source = obtain(options, config, stages)
    answers = estimate(source.recording, methods, config, stages)
    with_answer(answers)
    with stages.stage("evaluate"):
        answers = ask_themselves([*answers, *source.published], source.recording, config)
        estimates = with_answer(answers)
        metrics = evaluate(source.recording, answers)
        metrics += costs(answers[: len(methods)], source.recording, stages)
    result = described(options, config, source, estimates, metrics, mark)
    from scenarios.report.page import write_report  # here: matplotlib is no part of what a method takes

    with directory.prepare(options.out, name) as folder:
        with stages.stage("report"):
            write_run(folder.temporary, result)
            write_report(folder.temporary, result, stages.costs)
        directory.publish(folder, {**result.environment, "stages": stages.costs})
    show(result, options.format, folder.final)
    if options.view:
        view.run([folder.final], None)


def checked(options: Options) -> tuple[list[str], str]:
    """The methods to run, and the name of the run's folder. Raises `InputError`."""
    from scenarios.source import is_map, is_scenario

    if not options.recording:
        raise InputError(f"expected a scenario or a log; scenarios: {', '.join(CATALOGUE)}")
    check_seed(options.seed)
    methods = parse_names(f"{options.methods},{ONLINE if options.online else ''}", METHODS, "method")
    simulates = is_scenario(options.recording)
    if simulates and (options.relations or options.laser_mount):
        raise InputError("--relations and --laser-mount are for logs: a scenario knows its own truth")
    if simulates and (options.topic or options.odometry):
        raise InputError("--topic and --odometry are for ROS bags")
    if options.field_of_view is not None:
        if simulates:
            raise InputError("--field-of-view is for logs: a scenario knows its own laser")
        if not 0.0 < options.field_of_view <= 360.0:
            raise InputError(f"--field-of-view: expected degrees up to 360, got {options.field_of_view:g}")
    if options.dead_reckoning and not simulates:
        raise InputError("--dead-reckoning is for simulated robots: a log has what it has")
    if options.start and not (simulates and is_map(options.recording)):
        raise InputError("--start is for ROS maps: scenarios and logs have a start of their own")
    spoilt = name_part(parse_corruptions(options.corrupt))
    return methods, f"{run_name(options.recording)}{spoilt}-seed{options.seed}"


def run_name(target: str) -> str:
    """``drive.2024`` for ``logs/drive.2024.log.gz``: all that tells recordings of one folder apart."""
    from scenarios.source import MAP_SUFFIXES
    from slam.formats.text import recording_name

    path = Path(target)
    return path.stem if path.suffix in MAP_SUFFIXES else recording_name(path).removesuffix(".raw")


def configure(options: Options) -> MethodConfig:
    """The settings: the defaults, what a file says instead, what the shell says instead. Raises
    `InputError`."""
    from scenarios.methods.config import MethodConfig
    from slam.settings import read_settings, set_by_words

    config = MethodConfig()
    if options.config is not None:
        config = read_settings(options.config, config, under="methods")
    return with_matcher(set_by_words(config, options.settings), options.matcher)


def with_matcher(config: MethodConfig, name: str) -> MethodConfig:
    """The settings with another scan matcher in slamstitch's front end. Raises `InputError`."""
    from slam.matching.match import register

    if not name:
        return config
    try:
        return replace(
            config,
            slam=replace(config.slam, frontend=replace(config.slam.frontend, method=register(name))),
        )
    except ValueError as error:
        raise InputError(f"--matcher: {error}") from error


def obtain(options: Options, config: MethodConfig, stages: Stages) -> Source:
    """The recording, simulated or read; what it lacks is told."""
    found = _obtain(options, config, stages)
    if options.no_dead_reckoning:
        found = replace(found, recording=found.recording.without_dead_reckoning())
    for line in told(found.recording):
        stages.console.print(f"spoilt on purpose: {line}", highlight=False, soft_wrap=True)
    if found.recording.source == "none":
        why = (
            "--no-dead-reckoning"
            if options.no_dead_reckoning
            else "odometry.missing"
            if "odometry.missing" in found.recording.corruptions
            else "none in the log, or one that never changes"
        )
        stages.console.print(f"no dead reckoning ({why}): the laser alone tells how the robot moved")
    return found


def _obtain(options: Options, config: MethodConfig, stages: Stages) -> Source:
    from scenarios import source
    from slam.odometry.laser_mount import is_mount_unstated

    if source.is_scenario(options.recording):
        tell_of_compilation(stages)
        with stages.stage("simulate"):
            found = source.simulated(options.recording, options.seed, options.start, options.dead_reckoning)
            found = _spoilt(found, options)
        stages.console.print(f"the drive ended: {found.settings['ending']}", style="dim", highlight=False)
        return found
    with stages.stage("read"):
        found = source.logged(
            Path(options.recording),
            options.relations,
            options.laser_mount,
            field_of_view=options.field_of_view,
            topic=options.topic,
            odometry=options.odometry,
        )
        found = _spoilt(found, options)
    tell_of_compilation(stages)
    if not options.no_dead_reckoning and is_mount_unstated(found.recording):
        found = _with_mount(found, config, stages)
    tell_what_was_taken(found.recording, stages)
    return found


def _spoilt(found: Source, options: Options) -> Source:
    """The recording with the corruptions that are asked for. Raises `InputError`."""
    corruptions = parse_corruptions(options.corrupt)
    return replace(found, recording=corrupted(found.recording, corruptions, options.seed))


def _with_mount(found: Source, config: MethodConfig, stages: Stages) -> Source:
    """The recording with its laser's mount estimated where nobody states it, which is told."""
    from scenarios import source
    from slam.odometry.laser_mount import NoMount

    with stages.stage("mount"):
        found, mount = source.with_estimated_mount(found, config.slam)
    text = f"laser mount, estimated from the drive: {mount} (--laser-mount states another)"
    if isinstance(mount, NoMount):
        text = f"laser mount taken at the robot's origin: {mount.reason} (--laser-mount states another)"
    stages.console.print(text, highlight=False, soft_wrap=True)
    return found


def tell_what_was_taken(recording: Recording, stages: Stages) -> None:
    """In one line what was read of a log that holds more, and from where."""
    if recording.notes:
        (x, y), yaw = recording.laser.T_robot_laser[:2], math.degrees(recording.laser.T_robot_laser[2])
        source = recording.laser.mount_source or "nobody states it"
        mount = f"mount x {x:.3f} m, y {y:.3f} m, yaw {yaw:.1f}° ({source})"
        laser, *others = recording.notes
        text = "; ".join([laser, mount, *others])
        stages.console.print(f"took {text}", highlight=False, soft_wrap=True)


def tell_of_compilation(stages: Stages) -> None:
    """The first run on a machine compiles the kernels; nobody should wonder why it takes so long."""
    root = Path(__file__).resolve().parents[1]
    if not any(root.glob("slam/**/__pycache__/*.nbi")):
        stages.console.print("first run: compiling the kernels takes about a minute, once")


def estimate(
    recording: Recording, methods: list[str], config: MethodConfig, stages: Stages
) -> list[Estimate | NoEstimate]:
    """Every method's answer, in the order asked for; compiling and loading kernels is on nobody's bill."""
    from scenarios.methods.warm_up import warm_up_recording
    from slam.mapping.self_consistency import self_consistency

    with stages.stage("warm up"):
        short = warm_up_recording(recording)
        for name in methods:
            load_kernels(name, short, config)
        self_consistency(short, short.dead_reckoning)
    answers: list[Estimate | NoEstimate] = []
    for name in methods:
        with stages.stage(name):
            answers.append(METHODS[name](recording, config))
        tell_of_odometry(answers[-1], recording, stages)
    return answers


def tell_of_odometry(answer: Estimate | NoEstimate, recording: Recording, stages: Stages) -> None:
    """In a line what a method found wrong with a wheel odometry."""
    from stitch.mapping.estimate import Estimate

    if not isinstance(answer, Estimate) or answer.track is None or recording.source != "odometry":
        return
    told = [f"it is {answer.odometry_faults}, which was corrected"] if answer.odometry_faults else []
    if doubted := int(answer.track.contradicted.sum()):
        told.append(f"matches contradict it at {doubted} of {len(recording)} scans")
    if told:
        stages.console.print(
            f"odometry: {'; '.join(told)} ({answer.method})", highlight=False, soft_wrap=True
        )


def ask_themselves(
    answers: Sequence[Estimate | NoEstimate], recording: Recording, config: MethodConfig
) -> list[Estimate | NoEstimate]:
    """The answers, each with whether its map agrees with itself."""
    from scenarios.evaluation.self_consistency import with_self_consistency
    from stitch.mapping.estimate import Estimate

    asked = config.self_consistency
    return [
        with_self_consistency(one, recording, asked) if isinstance(one, Estimate) else one for one in answers
    ]


def with_answer(answers: Sequence[Estimate | NoEstimate]) -> list[Estimate]:
    """The answers that are some. Raises `InputError` where there is none, with every method's reason."""
    from stitch.mapping.estimate import Estimate

    found = [one for one in answers if isinstance(one, Estimate)]
    if not found:
        raise InputError(
            "; ".join(f"{one.method}: {one.reason}" for one in answers if not isinstance(one, Estimate))
        )
    return found


def costs(answers: Sequence[Estimate | NoEstimate], recording: Recording, stages: Stages) -> list[Metric]:
    """Wall time and memory of every method that ran here and had an answer."""
    from scenarios.evaluation import COST, cost, missing
    from stitch.mapping.estimate import NoEstimate

    metrics: list[Metric] = []
    for one in answers:
        if isinstance(one, NoEstimate):
            metrics += missing(one.method, COST, one.reason)
        else:
            paid = stages.costs[one.method]
            metrics += cost(one.method, paid.wall_s, len(recording), paid.peak_mb)
    return metrics


def described(
    options: Options,
    config: MethodConfig,
    source: Source,
    estimates: list[Estimate],
    metrics: list[Metric],
    fingerprint: str,
) -> Run:
    """The run with what it takes to make it again: the command line, every parameter, and the versions."""
    from scenarios.run_folder.write import Run
    from scenarios.stages import environment

    asked = {
        "command": shlex.join(["python", "-m", COMMAND, *sys.argv[1:]]),
        "options": asdict(options),
        "fingerprint": fingerprint,
        "corruptions": source.recording.corruptions,
        "scenario": source.settings,
        "methods": config,
    }
    return Run(asked, environment(), options.seed, source.recording, estimates, metrics, source.simulated)


def show(result: Run, form: str, folder: Path) -> None:
    """The results on stdout."""
    from scenarios.report.summary import consistency_sentences, tabulate

    if form == "json":
        print(result.metrics_json())
        return
    recording = result.recording
    title = f"{recording.name}: {len(recording)} scans, {recording.distance:.0f} m"
    tabulate(result.metrics).to_table(title).print()
    for sentence in consistency_sentences(result.estimates):
        print(sentence)
    print(folder / "report.html")


def print_settings(options: Options) -> None:
    """Every setting: its key, its value, and what it means."""
    from slam.settings import describe, to_words

    for key, value, meaning in describe(configure(options)):
        print(f"--{key} {' '.join(to_words(value))}\n    {meaning}")


def print_catalogue() -> None:
    """Every scenario: its size, the length of a drive, and why it exists."""
    for scenario in CATALOGUE.values():
        across, deep = scenario.size_m
        size, drive = f"{across:.0f} × {deep:.0f} m", f"{scenario.drive_m:.0f} m"
        print(f"{scenario.name:<13} {size:>11} {drive:>6}  {scenario.summary}")


def take(words: Words) -> tuple[Mapping[str, Sequence[str]], Words]:
    """The settings among the words of the command line; the tree of them is imported only where there are."""
    if not any(re.match(r"--[\w-]+\.", word) for word in words):
        return {}, words
    from scenarios.methods.config import MethodConfig
    from slam.settings import take_settings

    return take_settings(words, MethodConfig())


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run, take))
