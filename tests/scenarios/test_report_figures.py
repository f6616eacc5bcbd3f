"""Figures of pieces and stitches, and of how sure a method is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenarios.evaluation.segmentation import false_stitches
from scenarios.report import stitches
from scenarios.report.chapter3 import points_on, rasterise_points, rooms
from scenarios.report.figures import FigureSpec, run_specs, write_figures
from scenarios.report.trajectory_figures import draw_uncertainty
from slam import se2
from slam.colours import BLACK, BLUE, ORANGE, VERMILLION
from slam.recording import Laser, Recording
from stitch.alignment.result import Alternative, NoStitch, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

WALLS = points_on(rooms())
T = np.array([0.6, -0.4, np.radians(30.0)])
N = 30


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    """Two submaps of the same rooms, the second seen from ``T``; of its stitches the second is false."""
    a, b = rasterise_points(WALLS), rasterise_points(se2.transform(se2.inverse(T), WALLS))
    poses = np.zeros((N, 3))
    poses[5:] = T
    poses[:, 0] += 0.1 * np.arange(N)
    T_true = se2.between(poses[0], poses[5])
    right = Stitch(T_true, 1e-4 * np.eye(3), 3.0, 5.0, 0.9)
    tried = (
        LoopCandidate(0, 1, right, 1.0),
        LoopCandidate(0, 1, replace(right, T_a_b=T_true + np.array([1.0, 0.0, 0.0])), 1.0),
        LoopCandidate(0, 1, NoStitch("refused", Alternative(T_true, 1.0))),
        LoopCandidate(0, 1, NoStitch("no candidate")),
    )
    sure = np.tile(np.diag([1e-2, 1e-4, 1e-4]), (N, 1, 1))
    return Estimate("m", poses, sure, submaps=(a, replace(b, start=5, stop=N)), stitches=tried)


@pytest.fixture(scope="module")
def recording(estimate) -> Recording:
    angles = np.linspace(-1.5, 1.5, 31)
    return Recording(
        "r", np.arange(N), np.full((N, 31), 2.0), angles, Laser(), estimate.poses, truth=estimate.poses
    )


def test_walls_of_both_pieces_are_told_apart():
    a, b = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.1, 0.1], [3.0, 0.0], [1.2, 0.0]])
    (_, only_b, both) = (points for points, _, _ in stitches.pair_layers(np.zeros((0, 2)), b))
    assert (len(only_b), len(both)) == (3, 0)
    layers = {colour: points.tolist() for points, colour, _ in stitches.pair_layers(a, b)}
    assert layers == {BLUE: a.tolist(), ORANGE: [[3.0, 0.0], [1.2, 0.0]], BLACK: [[0.1, 0.1]]}


def test_a_sheet_has_a_title_for_every_tile_and_keeps_north_up():
    corner = np.array([[0.0, 0.0], [0.0, 4.0]])
    tiles = [stitches.Tile(f"tile {k}", ((corner, BLACK),)) for k in range(stitches.MAX_TILES + 3)]
    figure = stitches.draw_sheet(tiles)
    (ax,) = figure.axes
    titles = [text.get_text() for text in ax.texts]
    assert titles[0] == "tile 0, 4 m"
    assert titles[-1] == "and 3 more"
    low, high = ax.collections[0].get_offsets()[:2]
    assert high[1] - low[1] == pytest.approx(stitches.MAP_SHARE)
    assert not ax.yaxis_inverted()


def test_steps_are_the_accepted_stitches_and_false_ones_are_red(estimate):
    false = false_stitches(estimate, estimate.poses)
    assert false == {1}
    assert false_stitches(estimate, None) == frozenset()
    (ax,) = stitches.draw_accepted_stitches(estimate, false).axes
    assert [text.get_color() for text in ax.texts] == [BLACK, VERMILLION]


def test_a_stitch_is_drawn_with_its_evidence(estimate):
    drawable = [stitches.AlignedPair.of(estimate, stitch).complete for stitch in estimate.stitches]
    assert drawable == [True, True, True, False]
    figure = stitches.draw_stitch(estimate, estimate.stitches[0])
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert {"before", "after", "Hough spectra [°]", "X spectra [m]", "score within 2 m"} <= set(titles)
    with pytest.raises(ValueError, match="stitch 0-1 of m has no alignment to draw"):
        stitches.draw_stitch(estimate, estimate.stitches[3])


def test_uncertainty_is_drawn_ten_times_as_large(estimate, recording):
    figure = draw_uncertainty(recording, [Estimate("ins", estimate.poses), estimate], {"m": "m"})
    (ax,) = figure.axes
    outline = ax.collections[0].get_paths()[0].vertices
    assert np.ptp(outline[:, 0]) == pytest.approx(20.0 * np.sqrt(5.991e-2), rel=1e-2)


def test_figures_have_plain_names_and_are_drawn_when_rendered(estimate, recording, tmp_path):
    named = replace(estimate, method="a/b")
    specs = run_specs(recording, [named], [])
    assert [spec.name for spec in specs] == [
        "maps", "trajectories", "submaps-a_b", "steps-a_b", "stitch-a_b-0-1",
    ]  # fmt: skip
    figure = FigureSpec("p", specs[1].draw, "alt", "caption")
    write_figures(tmp_path / "new", [figure])
    assert (tmp_path / "new" / "p.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "new" / "p.pdf").read_bytes()[:5] == b"%PDF-"
    assert figure.size == (1320, figure.size[1])
