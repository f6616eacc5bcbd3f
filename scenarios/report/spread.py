"""The path of every method with how sure it is of it (report, figure A.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from scenarios.evaluation.trajectory import aligned
from scenarios.report.figures import legend, views
from scenarios.report.style import BLACK, SKY, VERMILLION, panels, titled
from slam import se2
from slam.odometry.track import Verdict
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CHI2_95 = 5.991
"""χ² of two degrees of freedom that 95 % stay under."""
TIMES = 10
"""How much larger than true the ellipses are drawn: centimetres would not show."""
EVERY = 0.5
"""Path between two ellipses [m]."""


def covariance_of(estimate: Estimate) -> tuple[Array, str] | None:
    """Covariance ``(N, 3, 3)`` in the body frame and of what: the pose where a method has marginals, else of
    the step from the scan each was matched to."""
    if estimate.covariance is not None:
        return estimate.covariance, "pose"
    if estimate.track is not None:
        return estimate.track.covariance, "step"
    return None


def in_axes(poses: Array, covariance: Array) -> Array:
    """Position covariances ``(..., 2, 2)`` m² in the axes of the ``poses (..., 3)``' frame."""
    R = se2.rotation(poses[..., 2])
    return R @ covariance[..., :2, :2] @ np.swapaxes(R, -1, -2)


def ellipses(poses: Array, covariance: Array, times: float = 1.0) -> Array:
    """Outlines ``(n, 33, 2)`` m that hold 95 %, ``times`` as large, of position covariances ``(n, 2, 2)``."""
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors * np.sqrt(CHI2_95 * np.maximum(values, 0.0))[:, None, :]
    around = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = np.stack([np.cos(around), np.sin(around)])
    return poses[:, None, :2] + times * np.swapaxes(axes @ circle, -1, -2)


def uncertainty(recording: Recording, estimates: Sequence[Estimate], titles: Mapping[str, str]) -> Figure:
    """The path of every method that says how sure it is, with ellipses; red where nothing was matched."""
    from matplotlib.collections import PolyCollection

    truth = recording.truth
    sure = [(e, found) for e in estimates if (found := covariance_of(e)) is not None]
    paths = [e.poses if truth is None else aligned(e.poses, truth) for e, _ in sure]
    shown, aspect = views([path if truth is None else truth for path in paths])
    figure, axes = panels(len(sure), aspect)
    for ax, (estimate, (covariance, what)), path, view in zip(axes, sure, paths, shown, strict=True):
        ax.axis(view)
        rows = _spaced(path, np.isfinite(covariance[:, 0, 0]))
        outlines = ellipses(path[rows], in_axes(path[rows], covariance[rows]), TIMES)
        ax.add_collection(
            PolyCollection(list(outlines), facecolors=SKY, edgecolors="none", alpha=0.45, rasterized=True)
        )
        ax.plot(path[:, 0], path[:, 1], color=BLACK, linewidth=0.8)
        if estimate.track is not None:
            tried = estimate.track.verdict != Verdict.SKIPPED
            lost = path[tried & (estimate.track.matches == 0)][1:]
            ax.plot(lost[:, 0], lost[:, 1], linestyle="none", marker="o", markersize=3, color=VERMILLION)
        title = f"{titles[estimate.method]}; covariance of each {what}"
        titled(ax, title)
    legend(
        figure,
        [("path", BLACK), (f"95 %, {TIMES} times as large", SKY), ("no match", VERMILLION)],
    )
    return figure


def _spaced(path: Array, known: np.ndarray) -> np.ndarray:
    """Rows ``(n,)`` about `EVERY` m of path apart, of those ``known (N,)``."""
    rows = np.flatnonzero(known)
    if len(rows) == 0:
        return rows
    bins = np.floor(se2.path_length(path)[rows] / EVERY)
    return rows[np.append(True, np.diff(bins) > 0.0)]
