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
from scenarios.evaluation.stitches import stitch_error
from scenarios.report import figures, spread, stitching, world
from scenarios.report.style import pdf, png
from scenarios.report.verdict import headline
from scenarios.run_folder.place import safe
from slam.recording import Recording
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.mapping.estimate import Estimate, LoopCandidate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim.record import SimulatedRun


def run(folders: Sequence[Path], out: Path | None) -> str:
    """Draw the figures of runs, one of every stitch with an alignment too, into their own folders ``figures``
    or into ``out/<run>``; returns the folders, one a line."""
    from scenarios.run_folder.reading import read

    places = []
    for folder in folders:
        recording, estimates, metrics = read(folder)
        every = {drawing.name: drawing for drawing in drawings(recording, estimates, metrics)}
        every |= {drawing.name: drawing for drawing in stitch_drawings(estimates)}
        places.append(folder / "figures" if out is None else out / folder.resolve().name)
        for drawing in every.values():
            write(places[-1], [drawing.plate()])
    return "\n".join(map(str, places))


@dataclass(frozen=True)
class Plate:
    """A figure drawn: its ``name``, PNG and PDF, what it shows in words, and its caption."""

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
class Drawing:
    """A figure that may be drawn."""

    name: str
    draw: Callable[[], Figure]
    alt: str
    caption: str

    def plate(self) -> Plate:
        """The figure, drawn."""
        figure = self.draw()
        return Plate(self.name, png(figure), pdf(figure), self.alt, self.caption)


def write(into: Path, plates: Sequence[Plate]) -> None:
    """Each figure as PNG and PDF."""
    into.mkdir(parents=True, exist_ok=True)
    for plate in plates:
        (into / f"{plate.name}.png").write_bytes(plate.png)
        (into / f"{plate.name}.pdf").write_bytes(plate.pdf)


def drawings(
    recording: Recording,
    estimates: Sequence[Estimate],
    metrics: Sequence[Metric],
    simulated: SimulatedRun | None = None,
) -> list[Drawing]:
    """The figures of a run, in the order of the page."""
    if not estimates:
        return []
    names = titles(estimates, metrics)
    return [
        *_results(recording, estimates, names),
        *_tracks(recording, estimates, names),
        *_stitchings(estimates, recording),
        *_worlds(simulated, estimates),
    ]


def titles(estimates: Sequence[Estimate], metrics: Sequence[Metric]) -> dict[str, str]:
    """Method -> its name and its score in the metric the run is judged by."""
    judged = headline(metrics)
    scores = {m.method: m.value for m in metrics if judged and m.name == judged[0] and m.value is not None}
    short = {"ate_rmse": "ATE", "relation_trans_mean": "relations"}
    return {
        e.method: f"{e.method}\n{short[judged[0]]} {scores[e.method]:.3f} m"
        if judged and e.method in scores
        else e.method
        for e in estimates
    }


def _results(
    recording: Recording, estimates: Sequence[Estimate], names: Mapping[str, str]
) -> Iterator[Drawing]:
    listed = ", ".join(estimate.method for estimate in estimates)
    over = "" if recording.truth is None else " over truth, after SE(2) alignment"
    for draw, what in ((figures.maps, "Maps"), (figures.trajectories, "Trajectories")):
        yield Drawing(
            what.lower(), partial(draw, recording, estimates, names), f"{what} of {listed}{over}",
            f"{what}{over}.",
        )  # fmt: skip


def _tracks(
    recording: Recording, estimates: Sequence[Estimate], names: Mapping[str, str]
) -> Iterator[Drawing]:
    """Confidence of every method with a track of its own, and the paths with their uncertainty."""
    drawn: list[Estimate] = []
    for estimate in estimates:
        if estimate.track is None or any(_same_track(estimate, other) for other in drawn):
            continue
        drawn.append(estimate)
        what = f"Confidence of {estimate.method}'s scan matches over the drive"
        name = f"confidence-{safe(estimate.method)}"
        yield Drawing(name, partial(figures.confidence, estimate), what, f"{what}.")
    if drawn:
        yield Drawing(
            "uncertainty", partial(spread.uncertainty, recording, drawn, names),
            f"Paths of {', '.join(estimate.method for estimate in drawn)} with ellipses of their uncertainty",
            f"How sure each method is of its place: ellipses that hold 95 %, {spread.TIMES} times as large.",
        )  # fmt: skip


def _same_track(one: Estimate, other: Estimate) -> bool:
    a, b = one.track, other.track
    return a is not None and b is not None and np.array_equal(a.poses, b.poses)


def _stitchings(estimates: Sequence[Estimate], recording: Recording) -> Iterator[Drawing]:
    """Pieces and steps of every method that cuts, and one stitch in full: the first false one, else the one
    with the largest overlap."""
    for estimate in estimates:
        method, name = estimate.method, safe(estimate.method)
        if not estimate.submaps:
            continue
        count = len(estimate.submaps)
        yield Drawing(
            f"submaps-{name}", partial(stitching.submaps, estimate),
            f"The {count} submaps of {method}, each in its own frame",
            f"The {count} submaps of {method}: number, first and last scan, size.",
        )  # fmt: skip
        accepted = [tried for tried in estimate.stitches if tried.accepted]
        if not accepted:
            continue
        false = false_stitches(estimate, recording.truth)
        yield Drawing(
            f"steps-{name}", partial(stitching.steps, estimate, false),
            f"The {len(accepted)} stitches of {method} one by one",
            f"The stitches that {method} accepted, one by one: where it put the second piece (orange) in the "
            "frame of the first (blue); black is in both. Red titles: false.",
        )  # fmt: skip
        yield stitch_drawing(estimate, _telling(estimate, false))


def false_stitches(estimate: Estimate, truth: Array | None) -> frozenset[int]:
    """Indices of the accepted stitches that are false; none where nobody knows."""
    if truth is None:
        return frozenset()
    errors = [stitch_error(estimate, tried, truth) for tried in estimate.stitches]
    return frozenset(
        k
        for k, (tried, error) in enumerate(zip(estimate.stitches, errors, strict=True))
        if tried.accepted and error is not None and error.false
    )


def stitch_drawing(estimate: Estimate, tried: LoopCandidate) -> Drawing:
    """One stitch in full."""
    what = f"Stitch of submap {tried.b} to {tried.a} by {estimate.method}"
    return Drawing(
        f"stitch-{safe(estimate.method)}-{tried.a}-{tried.b}",
        partial(stitching.one, estimate, tried, AlignConfig()),
        f"{what}: both pieces before and after, their spectra and correlations",
        f"{what}: the pieces before and after, Hough spectra and their correlation, X and Y spectra and "
        "theirs, the score of shifts; dotted: what was chosen.",
    )


def stitch_drawings(estimates: Sequence[Estimate]) -> Iterator[Drawing]:
    """Every stitch of every method that has an alignment to draw."""
    for estimate in estimates:
        for tried in estimate.stitches:
            if stitching.drawable(estimate, tried):
                yield stitch_drawing(estimate, tried)


def _telling(estimate: Estimate, false: frozenset[int]) -> LoopCandidate:
    if false:
        return estimate.stitches[min(false)]
    accepted = [tried for tried in estimate.stitches if tried.accepted]
    return max(accepted, key=lambda tried: getattr(tried.result, "overlap_area", 0.0))


def _worlds(simulated: SimulatedRun | None, estimates: Sequence[Estimate]) -> Iterator[Drawing]:
    """The world from above, the drive and where the Weighted Scan Matcher failed; a scan from the side."""
    if simulated is None:
        return
    matcher = next((estimate for estimate in estimates if estimate.method == "wsm"), None)
    yield Drawing(
        "world", partial(world.from_above, simulated, matcher),
        "The simulated world from above, the driven path coloured by the robot's tilt",
        "The world and the drive, coloured by tilt. Shaded: uneven ground (brown) and smoke (grey).",
    )  # fmt: skip
    yield Drawing(
        "tilt", partial(world.from_the_side, simulated),
        "One tilted scan from the side: where its beams meet the floor or a wall",
        "The scan with the most nose-down pitch, from the side: what a tilted laser takes for a wall.",
    )  # fmt: skip
