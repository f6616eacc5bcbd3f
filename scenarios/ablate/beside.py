"""Pictures of several answers beside the published one."""

from __future__ import annotations

import io
from collections.abc import Sequence

HEIGHT, DPI = 7.0, 110
"""Of the row of pictures [inch], and its resolution."""


def row(pictures: Sequence[tuple[str, bytes]]) -> bytes:
    """PNG of pictures ``(title, PNG)`` side by side, all of one height."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    images = [imread(io.BytesIO(png), format="png") for _, png in pictures]
    widths = [image.shape[1] / image.shape[0] for image in images]
    figure = Figure(figsize=(HEIGHT * sum(widths), HEIGHT + 0.5), layout="constrained")
    axes = figure.subplots(1, len(images), width_ratios=widths, squeeze=False)[0]
    for ax, image, (title, _) in zip(axes, images, pictures, strict=True):
        ax.imshow(image, cmap="gray", aspect="equal")
        ax.set_title(title, fontsize=11, parse_math=False, wrap=True)
        ax.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, facecolor="white")
    return buffer.getvalue()
