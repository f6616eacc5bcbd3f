"""Why two maps were joined, or not: the answer and its rivals side by side."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.mapping.submap import Submap
from stitch.alignment.result import Alternative, NoStitch, Stitch
from stitch.command import merge
from stitch.command.maps import as_probability

MOST = 3
"""Hypotheses that are drawn."""
SIDE, DPI = 5.0, 110
"""Width of a picture [inch] and resolution."""
WORDS = 60
"""Letters in a line of the reason."""


def draw(names: Sequence[str], a: Submap, b: Submap, result: Stitch | NoStitch) -> bytes:
    """PNG of the best candidates, best first, each with its score and belief, and why it was refused."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    shown = hypotheses(result)[:MOST]
    images = [imread(io.BytesIO(picture(names, a, b, one)), format="png") for one in shown]
    reason = result.reason if isinstance(result, NoStitch) else "accepted"
    tallest = max((image.shape[0] / image.shape[1] for image in images), default=0.0)
    figure = Figure(figsize=(SIDE * max(len(shown), 1), SIDE * tallest + 1.0), layout="constrained")
    figure.suptitle("\n".join(textwrap.wrap(reason, WORDS * max(len(shown), 1))), fontsize=10)
    for k, (one, image) in enumerate(zip(shown, images, strict=True)):
        ax = figure.add_subplot(1, len(shown), k + 1)
        ax.imshow(image)
        belief = "" if one.belief is None else f", belief {as_probability(one.belief):.0%}"
        ax.set_title(f"{k + 1}: score {one.score:.1f}{belief}", fontsize=9)
        ax.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, facecolor="white")
    return buffer.getvalue()


def hypotheses(result: Stitch | NoStitch) -> list[Stitch | Alternative]:
    """The answer, or the best candidate where it was refused, and its rivals, best first."""
    if isinstance(result, NoStitch):
        return [] if result.best is None else [result.best, *result.alternatives]
    return [result, *result.alternatives]


def picture(names: Sequence[str], a: Submap, b: Submap, one: Stitch | Alternative) -> bytes:
    """PNG of both maps, joined as a hypothesis has them."""
    placed = replace(b, grid=merge.bent(b.grid, one)) if one.bend is not None or one.scale != 1.0 else b
    lines = () if one.bend is None else one.bend.lines()
    resolution = max(a.grid.resolution, placed.grid.resolution)
    return merge.draw(names, [a.grid, placed.grid], [np.zeros(3), one.T_a_b], resolution, lines)
