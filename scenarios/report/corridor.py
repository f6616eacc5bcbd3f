"""What a corridor leaves unknown: the errors of the Weighted Scan Matcher and what each covariance claims.

The same experiment in a room and in a corridor. The closed-form covariances do not know that the matcher
finds new pairs at every step, and claim millimetres along a corridor that says nothing there; ``p2l`` counts
only what the walls' normals tell (Bonnabel et al. 2016).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from scenarios.bench.matching.calibration import PLAIN, Trials, pairs_at, seeded, trials
from scenarios.bench.matching.matchers import Variant
from scenarios.report.style import FONT, grid, png
from scenarios.report.trajectory_figures import CHI2_2_95
from slam.colours import BLACK, BLUE, SKY, VERMILLION
from slam.matching.config import CovarianceMode
from slam.se2 import Array

PAIRS, SEED = 300, 0
MODES: dict[CovarianceMode, tuple[str, str]] = {
    "pfister_block": (VERMILLION, "--"),
    "joint": (BLUE, "-."),
    "p2l": (BLACK, "-"),
}
"""Colour and dash of each covariance mode's ellipse."""
ACROSS = (-15.0, 27.0)
"""Lower and upper end [mm] of every panel, with room for words above the ellipses."""
VIEWS = (
    ("room of 6 × 4 m", "room", 21.0, "mm"),
    ("corridor: all matches", "corridor", 150.0, "mm"),
    ("corridor: what p2l claims", "corridor", 3.0, "m"),
)
"""Title of each panel, its place, and half its width with the unit of that."""


def run(out: Path) -> Path:
    """Draw the picture into the file ``out``, a PNG; returns it. Raises ``OSError`` if that cannot be
    written."""
    by_place = {place: experiment(place) for place in ("room", "corridor")}
    figure, axes = grid(len(VIEWS), len(VIEWS), 3.1, 2.6, 0.5, 0.0)
    for ax, (title, place, half, unit) in zip(axes, VIEWS, strict=True):
        draw(ax, by_place[place], 1.0 if unit == "m" else 1e-3)
        ax.set(xlim=(-half, half), ylim=ACROSS)
        ax.set_title(title, fontsize=FONT["title"])
        ax.set_xlabel(f"error along, x [{unit}]", fontsize=FONT["label"])
    axes[0].set_ylabel("error across, y [mm]", fontsize=FONT["label"])
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=4, fontsize=FONT["label"], frameon=False)
    out.write_bytes(png(figure))
    return out


def experiment(place: str) -> dict[CovarianceMode, Trials]:
    """The same pairs from one place, matched alike, with the covariance of every mode."""
    rng = np.random.default_rng(SEED)
    pairs = pairs_at(place, PAIRS, rng)
    guesses = seeded(pairs, rng)
    return {mode: trials(Variant("wsm", "wsm", mode, PLAIN), pairs, guesses) for mode in MODES}


def draw(ax: Axes, by_mode: dict[CovarianceMode, Trials], metres: float) -> None:
    """The cloud of errors (x in units of so many ``metres``), the modes' ellipses of 95 %, and the share of
    the errors that each holds."""
    errors = by_mode["joint"].errors
    ax.plot(errors[:, 0] / metres, 1e3 * errors[:, 1], ".", color=SKY, ms=4, label=f"{PAIRS} matches")
    for k, (mode, (colour, dash)) in enumerate(MODES.items()):
        x, y = ellipse(np.mean(by_mode[mode].covariances, axis=0)[:2, :2])
        ax.plot(x / metres, 1e3 * y, dash, color=colour, lw=1.8, label=f"{mode}, 95 %")
        share = f"{mode} holds {100.0 * coverage(by_mode[mode]):.0f} %"
        ax.text(0.03, 0.97 - 0.07 * k, share, color=colour, transform=ax.transAxes, va="top",
                fontsize=FONT["label"])  # fmt: skip


def ellipse(covariance: Array) -> Array:
    """Outline ``(2, K)`` of the ellipse of 95 % of ``covariance (2, 2)``."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    return np.sqrt(CHI2_2_95) * np.linalg.cholesky(covariance) @ np.stack([np.cos(turn), np.sin(turn)])


def coverage(matches: Trials) -> float:
    """Share of the errors in x and y that the ellipse of their own covariance holds."""
    errors = matches.errors[:, :2]
    solved = np.linalg.solve(matches.covariances[:, :2, :2], errors[..., None])[..., 0]
    return float(np.mean(np.sum(errors * solved, axis=1) <= CHI2_2_95))
