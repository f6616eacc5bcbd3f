"""The figures of a run, by name: for its page, and as PNG and PDF in its folder.

``python -m scenarios.report album RUN …`` draws them again, with one for every stitch.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.evaluation.metric import Metric
from scenarios.evaluation.segmentation import stitch_error
from scenarios.report import stitch_figures, trajectory_figures, world_figures
from scenarios.report.alignment_evidence import AlignedPair
from scenarios.report.style import pdf, png
from scenarios.report.verdict import headline, headline_scores
from scenarios.run_folder.directory import safe_name
from scenarios.run_folder.read import read_run
from slam.recording import Recording
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.mapping.estimate import Estimate, LoopCandidate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim.record import SimulatedRun


def run(folders: Sequence[Path], out: Path | None) -> str:
    """Draw the figures of runs, one of every stitch with an alignment too, into their own folders ``figures``
    or into ``out/<run>``; returns the folders, one a line. Raises `InputError`."""
    targets = []
    for folder in folders:
        specs = album_specs(*read_run(folder))
        targets.append(folder / "figures" if out is None else out / folder.resolve().name)
        for spec in specs:
            write_figures(targets[-1], [spec.render()])
    return "\n".join(map(str, targets))


@dataclass(frozen=True)
class RenderedFigure:
    """A figure as PNG and PDF: its ``name``, what it shows in words, and its caption."""

    name: str
    png: bytes
    pdf: bytes
    alt: str
    caption: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the PNG in pixels."""
        width, height = struct.unpack(">II", self.png[16:24])
        return width, height


@dataclass(frozen=True)
class FigureSpec:
    """A figure that can be drawn, with what it shows in words and its caption."""

    name: str
    draw: Callable[[], Figure]
    alt: str
    caption: str

    def render(self) -> RenderedFigure:
        """Draw the figure."""
        figure = self.draw()
        return RenderedFigure(self.name, png(figure), pdf(figure), self.alt, self.caption)


def write_figures(folder: Path, figures: Sequence[RenderedFigure]) -> None:
    """Write each figure as PNG and PDF."""
    folder.mkdir(parents=True, exist_ok=True)
    for figure in figures:
        (folder / f"{figure.name}.png").write_bytes(figure.png)
        (folder / f"{figure.name}.pdf").write_bytes(figure.pdf)


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
        *_stitch_specs(estimates, recording),
        *_world_specs(simulated, estimates),
    ]


def album_specs(
    recording: Recording, estimates: Sequence[Estimate], metrics: Sequence[Metric]
) -> list[FigureSpec]:
    """The figures of a run and one of every stitch that has an alignment to draw, each name once."""
    specs = {spec.name: spec for spec in run_specs(recording, estimates, metrics)}
    for estimate in estimates:
        for stitch in estimate.stitches:
            if AlignedPair.of(estimate, stitch).complete:
                spec = _stitch_spec(estimate, stitch)
                specs[spec.name] = spec
    return list(specs.values())


def figure_titles(estimates: Sequence[Estimate], metrics: Sequence[Metric]) -> dict[str, str]:
    """Method -> its name and its score in the metric the run is judged by."""
    judged, scores = headline(metrics), headline_scores(metrics)
    short = {"ate_rmse": "ATE", "relation_trans_mean": "relations"}
    return {
        e.method: f"{e.method}\n{short[judged[0]]} {scores[e.method]:.3f} m"
        if judged and e.method in scores
        else e.method
        for e in estimates
    }


def _result_specs(
    recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]
) -> Iterator[FigureSpec]:
    methods = ", ".join(estimate.method for estimate in estimates)
    over = "" if recording.truth is None else " over truth, after SE(2) alignment"
    for draw, what in (
        (trajectory_figures.draw_maps, "Maps"),
        (trajectory_figures.draw_trajectories, "Trajectories"),
    ):
        draw_all = partial(draw, recording, estimates, titles)
        yield FigureSpec(what.lower(), draw_all, f"{what} of {methods}{over}", f"{what}{over}.")


def _track_specs(
    recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]
) -> Iterator[FigureSpec]:
    """Confidence of every method with a track of its own, and the paths with their uncertainty."""
    drawn: list[Estimate] = []
    for estimate in estimates:
        if estimate.track is None or any(_same_track(estimate, other) for other in drawn):
            continue
        drawn.append(estimate)
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


def _same_track(one: Estimate, other: Estimate) -> bool:
    a, b = one.track, other.track
    return a is not None and b is not None and np.array_equal(a.poses, b.poses)


def _stitch_specs(estimates: Sequence[Estimate], recording: Recording) -> Iterator[FigureSpec]:
    """Submaps and accepted stitches of every method that cuts, and one stitch in full: the first false one,
    else the one with the largest overlap."""
    for estimate in estimates:
        method, name = estimate.method, safe_name(estimate.method)
        if not estimate.submaps:
            continue
        count = len(estimate.submaps)
        yield FigureSpec(
            f"submaps-{name}", partial(stitch_figures.draw_submaps, estimate),
            f"The {count} submaps of {method}, each in its own frame",
            f"The {count} submaps of {method}: number, first and last scan, size.",
        )  # fmt: skip
        accepted = [stitch for stitch in estimate.stitches if stitch.accepted]
        if not accepted:
            continue
        false = false_stitches(estimate, recording.truth)
        yield FigureSpec(
            f"steps-{name}", partial(stitch_figures.draw_accepted_stitches, estimate, false),
            f"The {len(accepted)} stitches of {method} one by one",
            f"The stitches that {method} accepted, one by one: where it put the second submap (orange) in "
            "the frame of the first (blue); black is in both. Red titles: false.",
        )  # fmt: skip
        largest = max(accepted, key=lambda stitch: getattr(stitch.result, "overlap_area", 0.0))
        yield _stitch_spec(estimate, estimate.stitches[min(false)] if false else largest)


def false_stitches(estimate: Estimate, truth: Array | None) -> frozenset[int]:
    """Indices of the accepted stitches that are false; none where there is no truth."""
    if truth is None:
        return frozenset()
    errors = [stitch_error(estimate, stitch, truth) for stitch in estimate.stitches]
    return frozenset(
        k
        for k, (stitch, error) in enumerate(zip(estimate.stitches, errors, strict=True))
        if stitch.accepted and error is not None and error.false
    )


def _stitch_spec(estimate: Estimate, stitch: LoopCandidate) -> FigureSpec:
    what = f"Stitch of submap {stitch.b} to {stitch.a} by {estimate.method}"
    return FigureSpec(
        f"stitch-{safe_name(estimate.method)}-{stitch.a}-{stitch.b}",
        partial(stitch_figures.draw_stitch, estimate, stitch, AlignConfig()),
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
