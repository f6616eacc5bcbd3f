"""python -m scenarios.score RECORDING ANSWER …: what others answered, scored as our own methods are."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from scenarios import run as road
from slam.cli import POSE, InputError, Pose, main

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from scenarios.evaluation.metric import Metric
    from scenarios.methods.config import MethodConfig
    from scenarios.run_folder.write import Run
    from scenarios.score.answers import Answer
    from scenarios.source import Source
    from scenarios.stages import Stages
    from slam.recording import Recording
    from stitch.mapping.estimate import Estimate, NoEstimate

COMMAND = "scenarios.score"


@dataclass(frozen=True)
class Origin:
    """Where an answer is from, beyond its file: ``version`` of the system, its wall time [s], peak memory
    [MB]."""

    version: str
    wall_s: float
    peak_mb: float


@dataclass(frozen=True)
class Options:
    """Score trajectories and maps that any system made of a recording: table, page and folder as of a run.

    A trajectory is a TUM file (perhaps with a covariance behind each pose, 21 or 6 numbers), a SQUARE file, a
    corrected CARMEN log, an npz of time, poses and covariance, or lines "stamp x y theta"; a map is named by
    its yaml. Below 90 % of the scans there is no answer; what is missing of the rest is interpolated.
    """

    recording: Positional[Annotated[str, arg(metavar="RECORDING", help_behavior_hint="")]]
    """A scenario (with --seed), a log with truth or relations, or the folder of a suite's recording."""
    answers: Positional[Annotated[tuple[Path, ...], arg(metavar="ANSWER", help_behavior_hint="")]]
    """Files, each scored under its own name."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """Which of a scenario's drives was answered."""
    methods: Annotated[str, arg(metavar="A,B,…", help_behavior_hint="")] = ""
    """Methods of ours to run beside them, separated by commas; without, the answers stand alone."""
    tolerance: Annotated[float, arg(metavar="S")] = 0.02
    """How far a pose's stamp may be from its scan's [s]."""
    poses_of: Annotated[
        Literal["robot", "laser"] | None, arg(metavar="robot|laser", help_behavior_hint="")
    ] = None
    """Whose poses they are, where a file does not say; without, the robot's, or the laser's where nobody
    states how it is mounted."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("runs")
    """Folder that the run's folder is put into."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    truth: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """True poses of the robot at every scan, where they are not in the recording; those of a suite's
    recording are found beside it."""
    relations: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """File of true relative poses to score a log against."""
    laser_mount: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Laser in the robot's frame in m and rad, where a log does not tell."""
    topic: Annotated[str, arg(metavar="TOPIC", help_behavior_hint="")] = ""
    """Which of a ROS bag's lasers to read."""
    odometry: Annotated[str, arg(metavar="TOPIC", help_behavior_hint="")] = ""
    """Which odometry of a ROS bag."""
    field_of_view: Annotated[float | None, arg(metavar="DEG", help_behavior_hint="")] = None
    """What the laser spans, where a text log does not tell."""


def run(options: Options, origins: Mapping[str, Origin] | None = None, command: str = COMMAND) -> None:
    """Answers → matched to the recording → metrics, beside those of our methods → run folder → table.

    ``origins`` tell of answers, by their names, that ``command`` made.
    """
    origins = origins or {}
    if not options.answers:
        raise InputError("expected one or more answers: answer.tum, corrected.log, poses.npz or map.yaml")
    if not 0.0 <= options.tolerance <= 1.0:
        raise InputError(f"--tolerance: expected 0 to 1 s, got {options.tolerance:g}")
    wanted = _as_run(options)
    methods, name = road.checked(wanted)

    from rich.console import Console

    from scenarios.evaluation import cost
    from scenarios.methods import METHODS
    from scenarios.run_folder import directory
    from scenarios.run_folder.write import write_run
    from scenarios.score.answers import read_answers
    from scenarios.score.truth import truth_beside, with_truth
    from scenarios.stages import Stages

    answers = read_answers(options.answers, [*METHODS, "truth"])
    mark = wanted.recording if wanted.recording in road.CATALOGUE else directory.fingerprint(wanted.recording)
    name = directory.vacant_name(options.out, f"{name}-score", mark)
    directory.check(options.out, name)
    config, stages = road.configure(wanted), Stages(Console(stderr=True))
    source = road.obtain(wanted, config, stages)
    truth = options.truth or truth_beside(wanted.recording)
    if truth is not None:
        recording = with_truth(source.recording, truth, options.tolerance)
        source = replace(source, recording=recording)
    handed, metrics = scored(answers, source.recording, options, stages)
    ours = road.estimate(source.recording, methods, config, stages) if options.methods else []
    result = described(options, config, source, [*ours, *handed], mark)
    metrics = [*judged(ours, result.recording, stages), *metrics]
    for one, origin in origins.items():
        metrics += cost(one, origin.wall_s, len(source.recording), origin.peak_mb)
    asked = {**result.asked, "command": shlex.join(["python", "-m", command, *sys.argv[1:]])}
    made = {**result.environment, "peers": {one: origin.version for one, origin in origins.items()}}
    result = replace(result, metrics=metrics, asked=asked, environment=made)
    from scenarios.report.page import write_report  # here: matplotlib is no part of what a method takes

    with directory.prepare(options.out, name) as folder:
        with stages.stage("report"):
            write_run(folder.temporary, result)
            write_report(folder.temporary, result, stages.costs)
        directory.publish(folder, {**result.environment, "stages": stages.costs})
    road.show(result, options.format, folder.final)


def _as_run(options: Options) -> road.Options:
    """The same recording as a run takes it. Raises `InputError`."""
    from scenarios.methods import BASELINE
    from scenarios.score.truth import entry_file

    return road.Options(
        recording=entry_file(options.recording),
        seed=options.seed,
        methods=options.methods or BASELINE,
        relations=options.relations,
        laser_mount=options.laser_mount,
        topic=options.topic,
        odometry=options.odometry,
        field_of_view=options.field_of_view,
    )


def scored(
    answers: Sequence[Answer], recording: Recording, options: Options, stages: Stages
) -> tuple[list[Estimate], list[Metric]]:
    """The trajectories that count as answers, and the metrics of all that was handed in.

    How many scans each covers is told. Raises `InputError` where nothing of it counts.
    """
    from scenarios.evaluation import JUDGED, evaluate, missing, to_metrics
    from scenarios.score.answers import to_estimate
    from scenarios.score.maps import map_answer_metrics
    from stitch.mapping.estimate import Estimate

    found: list[Estimate | NoEstimate] = []
    metrics: list[Metric] = []
    body = options.poses_of or ("laser" if recording.laser.mount_source == "the drive" else "robot")
    for one in answers:
        if one.trajectory is None:
            values = map_answer_metrics(one.path, recording)
            metrics += to_metrics(one.name, values)
            rest = [name for name in JUDGED if name not in values]
            metrics += missing(one.name, rest, "a map states no poses")
            continue
        estimate, coverage = to_estimate(one.name, one.trajectory, recording, options.tolerance, body)
        metrics += to_metrics(one.name, {"coverage": coverage})
        found.append(estimate)
        text = f"{one.name}: {len(one.trajectory)} poses, {coverage:.1%} of the scans within"
        stages.console.print(f"{text} {options.tolerance:g} s", highlight=False, soft_wrap=True)
    if len(found) == len(answers) and not options.methods:
        road.with_answer(found)
    metrics += evaluate(recording, found)
    return [one for one in found if isinstance(one, Estimate)], metrics


def judged(ours: Sequence[Estimate | NoEstimate], recording: Recording, stages: Stages) -> list[Metric]:
    """What our methods' answers are worth, and what they cost."""
    from scenarios.evaluation import evaluate

    with stages.stage("evaluate"):
        return [*evaluate(recording, ours), *road.costs(ours, recording, stages)]


def described(
    options: Options,
    config: MethodConfig,
    source: Source,
    answers: Sequence[Estimate | NoEstimate],
    fingerprint: str,
) -> Run:
    """The run, without metrics as yet, with what it takes to make it again."""
    from scenarios.run_folder.write import Run
    from scenarios.stages import environment
    from stitch.mapping.estimate import Estimate

    asked = {
        "options": asdict(options),
        "fingerprint": fingerprint,
        "scenario": source.settings,
        "methods": config,
    }
    estimates = [one for one in answers if isinstance(one, Estimate)]
    return Run(asked, environment(), options.seed, source.recording, estimates, [], source.simulated)


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
