"""The figures of a run, by name: for its page, and as PNG and PDF in its folder.

``python -m scenarios.report album RUN …`` draws them again, with one for every stitch.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scenarios.evaluation.metric import Metric
from scenarios.evaluation.segmentation import false_stitches
from scenarios.report import stitches, trajectory_figures, world_figures
from scenarios.report.style import pdf, png
from scenarios.report.summary import headline
from scenarios.run_folder.directory import safe_name
from scenarios.run_folder.read import read_run
from sim.record import SimulatedRun
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate, LoopCandidate


def run(folders: Sequence[Path], out: Path | None) -> str:
    """Draw the figures of runs, one of every stitch with an alignment too, into their own folders ``figures``
    or into ``out/<run>``; returns the folders, one a line. Raises `InputError`."""
    targets = []
    for folder in folders:
        recording, estimates, metrics = read_run(folder)
        every_stitch = (
            _stitch_spec(estimate, stitch)
            for estimate in estimates
            for stitch in estimate.stitches
            if stitches.AlignedPair.of(estimate, stitch).complete
        )
        specs = [*run_specs(recording, estimates, metrics), *every_stitch]
        targets.append(folder / "figures" if out is None else out / folder.resolve().name)
        write_figures(targets[-1], {spec.name: spec for spec in specs}.values())
    return "\n".join(map(str, targets))


@dataclass(frozen=True)
class FigureSpec:
    """A figure with a name, what it shows in words and its caption; drawn when its files are asked for."""

    name: str
    draw: Callable[[], Figure]
    alt: str
    caption: str

    @cached_property
    def files(self) -> dict[str, bytes]:
        """The figure as ``png`` and ``pdf``."""
        figure = self.draw()
        return {"png": png(figure), "pdf": pdf(figure)}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the PNG in pixels."""
        width, height = struct.unpack(">II", self.files["png"][16:24])
        return width, height


def write_figures(folder: Path, specs: Iterable[FigureSpec]) -> None:
    """Write each figure as PNG and PDF."""
    folder.mkdir(parents=True, exist_ok=True)
    for spec in specs:
        for ending, data in spec.files.items():
            (folder / f"{spec.name}.{ending}").write_bytes(data)


def run_specs(
    recording: Recording,
    estimates: Sequence[Estimate],
    metrics: Sequence[Metric],
    simulated: SimulatedRun | None = None,
) -> list[FigureSpec]:
    """The figures of a run, in the order of the page."""
    if not estimates:
        return []
    titles = figure_titles(estimates, metrics)
    return [
        *_result_specs(recording, estimates, titles),
        *_track_specs(recording, estimates, titles),
        *(spec for estimate in estimates for spec in _stitch_specs(estimate, recording.truth)),
        *_world_specs(simulated, estimates),
    ]


def figure_titles(estimates: Sequence[Estimate], metrics: Sequence[Metric]) -> dict[str, str]:
    """Method -> its name and its score in the metric the run is judged by."""
    titles, judged = {estimate.method: estimate.method for estimate in estimates}, headline(metrics)
    if judged is None:
        return titles
    short = {"ate_rmse": "ATE", "relation_trans_mean": "relations"}[judged.name]
    scored = {m: f"{m}\n{short} {score:.3f} m" for m, score in judged.scores.items() if m in titles}
    return {**titles, **scored}


def _result_specs(
    recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]
) -> Iterator[FigureSpec]:
    methods = ", ".join(titles)
    over = "" if recording.truth is None else " over truth, after SE(2) alignment"
    draws = {"Maps": trajectory_figures.draw_maps, "Trajectories": trajectory_figures.draw_trajectories}
    for what, draw in draws.items():
        draw_all = partial(draw, recording, estimates, titles)
        yield FigureSpec(what.lower(), draw_all, f"{what} of {methods}{over}", f"{what}{over}.")


def _track_specs(
    recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]
) -> Iterator[FigureSpec]:
    """Confidence of every method with a track of its own, and the paths with their uncertainty."""
    drawn: list[Estimate] = []
    tracks: list[Array] = []
    for estimate in estimates:
        if estimate.track is None or any(np.array_equal(estimate.track.poses, other) for other in tracks):
            continue
        drawn.append(estimate)
        tracks.append(estimate.track.poses)
        what = f"Confidence of {estimate.method}'s scan matches over the drive"
        name = f"confidence-{safe_name(estimate.method)}"
        yield FigureSpec(name, partial(trajectory_figures.draw_confidence, estimate), what, f"{what}.")
    if drawn:
        scale = trajectory_figures.ELLIPSE_SCALE
        yield FigureSpec(
            "uncertainty", partial(trajectory_figures.draw_uncertainty, recording, drawn, titles),
            f"Paths of {', '.join(estimate.method for estimate in drawn)} with ellipses of their uncertainty",
            f"How sure each method is of its place: ellipses that hold 95 %, {scale} times as large.",
        )  # fmt: skip


def _stitch_specs(estimate: Estimate, truth: Array | None) -> Iterator[FigureSpec]:
    """Submaps and accepted stitches of a method that cuts, and one stitch in full: the first false one, else
    the one with the largest overlap."""
    method, name, count = estimate.method, safe_name(estimate.method), len(estimate.submaps)
    if not count:
        return
    yield FigureSpec(
        f"submaps-{name}", partial(stitches.draw_submaps, estimate),
        f"The {count} submaps of {method}, each in its own frame",
        f"The {count} submaps of {method}: number, first and last scan, size.",
    )  # fmt: skip
    accepted = [stitch for stitch in estimate.stitches if stitch.accepted]
    if not accepted:
        return
    false = false_stitches(estimate, truth)
    yield FigureSpec(
        f"steps-{name}", partial(stitches.draw_accepted_stitches, estimate, false),
        f"The {len(accepted)} stitches of {method} one by one",
        f"The stitches that {method} accepted, one by one: where it put the second submap (orange) in "
        "the frame of the first (blue); black is in both. Red titles: false.",
    )  # fmt: skip
    largest = max(accepted, key=lambda stitch: getattr(stitch.result, "overlap_area", 0.0))
    yield _stitch_spec(estimate, estimate.stitches[min(false)] if false else largest)


def _stitch_spec(estimate: Estimate, stitch: LoopCandidate) -> FigureSpec:
    what = f"Stitch of submap {stitch.b} to {stitch.a} by {estimate.method}"
    return FigureSpec(
        f"stitch-{safe_name(estimate.method)}-{stitch.a}-{stitch.b}",
        partial(stitches.draw_stitch, estimate, stitch),
        f"{what}: both submaps before and after, their spectra and correlations",
        f"{what}: the submaps before and after, Hough spectra and their correlation, X and Y spectra and "
        "theirs, the score of shifts; dotted: what was chosen.",
    )


def _world_specs(simulated: SimulatedRun | None, estimates: Sequence[Estimate]) -> Iterator[FigureSpec]:
    """The world from above, the drive and where the Weighted Scan Matcher failed; a scan from the side."""
    if simulated is None:
        return
    matcher = next((estimate for estimate in estimates if estimate.method == "wsm"), None)
    yield FigureSpec(
        "world", partial(world_figures.draw_from_above, simulated, matcher),
        "The simulated world from above, the driven path coloured by the robot's tilt",
        "The world and the drive, coloured by tilt. Shaded: uneven ground (brown) and smoke (grey).",
    )  # fmt: skip
    yield FigureSpec(
        "tilt", partial(world_figures.draw_from_the_side, simulated),
        "One tilted scan from the side: where its beams meet the floor or a wall",
        "The scan with the most nose-down pitch, from the side: what a tilted laser takes for a wall.",
    )  # fmt: skip
