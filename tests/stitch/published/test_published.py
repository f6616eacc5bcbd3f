"""The published methods: cut-outs of drawn floor plans with a known answer, and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from stitch import NoStitch, Prior, Stitch, align
from stitch.align import METHODS, AlignConfig
from stitch.alignment.config import DirectionConfig, FeatureConfig
from stitch.alignment.hough import common_directions, reason_against_directions
from stitch.alignment.raster import Raster
from stitch.alignment.translation import lags
from stitch.published.carpin import acceptance_index, redraw
from stitch.published.censi import solutions
from stitch.published.features import fit_rigid
from stitch.published.htms import four_hypotheses
from stitch.published.pair import Pair

OLD = [method for method in METHODS if method != "joint"]
PLACES = np.array([[12.0, 10.5, 0.7], [18.0, 9.0, -2.0]])
"""Of the frames of two cut-outs in the plan of `rooms`, far from upright."""
T_TRUE = se2.between(PLACES[0], PLACES[1])
SIDE = 0.1


def config(method: str) -> AlignConfig:
    return AlignConfig(method=method)


def on(segments: np.ndarray) -> np.ndarray:
    """Points every 5 cm on segments (S, 4)."""
    parts = []
    for s in segments:
        count = int(np.hypot(*(s[2:] - s[:2])) / 0.05) + 2
        parts.append(s[:2] + np.linspace(0.0, 1.0, count)[:, None] * (s[2:] - s[:2]))
    return np.concatenate(parts)


def cut_out(
    points: np.ndarray,
    frame: np.ndarray,
    low: list[float],
    high: list[float],
    plan: dict[str, Any],
    side: float = SIDE,
) -> Submap:
    """What lies between two corners of the plan, drawn in a frame of its own; what is not a wall is free."""
    corners = np.array([low, high, [low[0], high[1]], [high[0], low[1]]])
    back = se2.inverse(frame)
    walls = se2.transform(back, points[np.all((points >= low) & (points <= high), axis=1)])
    ends = se2.transform(back, corners) / side
    first = np.floor(ends.min(axis=0)) - 1.0
    width, height = (np.ceil(ends.max(axis=0)) + 2.0 - first).astype(int)
    occupied = np.zeros((height, width), dtype=bool)
    column, row = (np.floor(walls / side) - first).astype(int).T
    occupied[row, column] = True
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    there = se2.transform(frame, ((first + np.stack([columns, rows], -1) + 0.5) * side).reshape(-1, 2))
    inside = np.all((there >= low) & (there <= high), axis=1).reshape(height, width)
    grid = Grid(occupied, inside & ~occupied, first * side, side)
    return Submap(0, 1, frame, plan["scan_of"](walls), grid)


@pytest.fixture(scope="module")
def floor(plan: dict[str, Any]) -> np.ndarray:
    rng = np.random.default_rng(11)
    points = on(plan["rooms"](rng))
    return points + rng.normal(0.0, 0.02, points.shape)


@pytest.fixture(scope="module")
def most(floor: np.ndarray, plan: dict[str, Any]) -> tuple[Submap, Submap]:
    """Two cut-outs that share four fifths."""
    return (
        cut_out(floor, PLACES[0], [-1.0, -1.0], [25.0, 21.0], plan),
        cut_out(floor, PLACES[1], [5.0, -1.0], [31.0, 21.0], plan),
    )


@pytest.fixture(scope="module")
def strangers(plan: dict[str, Any], most: tuple[Submap, Submap]) -> tuple[Submap, Submap]:
    other = on(plan["rooms"](np.random.default_rng(12)))
    return most[0], cut_out(other, PLACES[1], [5.0, -1.0], [31.0, 21.0], plan)


def error(T_true: np.ndarray, T: np.ndarray) -> tuple[float, float]:
    """Distance [m] and angle [degrees] between two poses."""
    xi = se2.between(T_true, T)
    return float(np.hypot(xi[0], xi[1])), float(np.degrees(abs(xi[2])))


def told(method: str, T_true: np.ndarray = T_TRUE) -> Prior | None:
    """The thesis's method needs to be told the rotation, as by an inertial sensor."""
    guess = T_true + np.array([3.0, -2.0, np.radians(7.0)])
    return Prior(guess, np.diag([4.0, 4.0, 0.2]) ** 2) if method == "htms" else None


def test_a_method_is_one_entry(most: tuple[Submap, Submap], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"expected one of joint, htms, .*, got 'mine'"):
        AlignConfig(method="mine")
    monkeypatch.setitem(METHODS, "mine", lambda a, b, prior, config: NoStitch(f"{config.method} has no idea"))
    assert align(*most, config=config("mine")) == NoStitch("mine has no idea")


@pytest.mark.parametrize("method", OLD)
def test_a_large_overlap_is_found(most: tuple[Submap, Submap], method: str) -> None:
    answer = align(*most, told(method), config(method))
    assert isinstance(answer, Stitch), answer
    metres, degrees = error(T_TRUE, answer.T_a_b)
    assert metres < 0.06
    assert degrees < 0.5
    assert answer.covariance is None
    assert answer.agreement > 0.9
    assert 350.0 < answer.overlap_area < 440.0  # 20 by 22 m, less the cells beside walls


@pytest.mark.parametrize("method", OLD)
def test_the_other_way_round_is_the_inverse(most: tuple[Submap, Submap], method: str) -> None:
    there = align(*most, told(method), config(method))
    back = align(*most[::-1], told(method, se2.inverse(T_TRUE)), config(method))
    assert isinstance(there, Stitch)
    assert isinstance(back, Stitch)
    metres, degrees = error(se2.inverse(there.T_a_b), back.T_a_b)
    assert metres < 0.1
    assert degrees < 0.01


@pytest.mark.parametrize("method", OLD)
def test_the_same_twice(most: tuple[Submap, Submap], method: str) -> None:
    first, second = (align(*most, told(method), config(method)) for _ in range(2))
    assert isinstance(first, Stitch)
    assert isinstance(second, Stitch)
    np.testing.assert_array_equal(first.T_a_b, second.T_a_b)
    assert first.score == second.score


@pytest.mark.parametrize("method", ["carpin", "censi", "akaze", "orb"])
def test_grids_of_different_resolution(floor: np.ndarray, plan: dict[str, Any], method: str) -> None:
    a = cut_out(floor, PLACES[0], [-1.0, -1.0], [25.0, 21.0], plan)
    b = cut_out(floor, PLACES[1], [5.0, -1.0], [31.0, 21.0], plan, side=0.06)
    answer = align(a, b, None, config(method))
    assert isinstance(answer, Stitch), answer
    assert error(T_TRUE, answer.T_a_b)[0] < 0.15


@pytest.mark.parametrize("method", OLD)
def test_an_empty_map_has_a_reason(most: tuple[Submap, Submap], method: str) -> None:
    blank = np.zeros((5, 4), dtype=bool)
    nothing = replace(most[0], grid=Grid(blank, ~blank, np.zeros(2), SIDE))
    for maps, name in (((nothing, most[1]), "a"), ((most[0], nothing), "b")):
        answer = align(*maps, config=config(method))
        assert isinstance(answer, NoStitch)
        assert f"submap {name} has no occupied cells" in answer.reason


@pytest.mark.parametrize("method", OLD)
def test_one_occupied_cell_is_survived(most: tuple[Submap, Submap], method: str) -> None:
    one = np.ones((1, 1), dtype=bool)
    dot = replace(most[0], grid=Grid(one, ~one, np.zeros(2), SIDE))
    answer = align(most[0], dot, config=config(method))
    assert isinstance(answer, Stitch if method == "htms" else NoStitch)


@pytest.mark.parametrize("method", OLD)
def test_a_single_wall_slides_along_itself(plan: dict[str, Any], method: str) -> None:
    wall = on(np.array([[0.0, 10.0, 30.0, 10.0]]))
    a = cut_out(wall, PLACES[0], [2.0, 5.0], [25.0, 15.0], plan)
    b = cut_out(wall, PLACES[1], [5.0, 5.0], [28.0, 15.0], plan)
    answer = align(a, b, told(method), config(method))
    if method == "htms":  # it has no way to refuse, but does not claim to know how sure it is
        assert isinstance(answer, Stitch)
        assert answer.covariance is None
        return
    assert isinstance(answer, NoStitch)
    assert ("one direction" if method in ("carpin", "censi") else "features") in answer.reason


@pytest.mark.parametrize("method", ["carpin", "censi", "akaze", "orb"])
def test_a_circle_has_no_directions(plan: dict[str, Any], method: str) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 2000)
    circle = np.array([15.0, 10.0]) + 6.0 * np.stack([np.cos(angle), np.sin(angle)], -1)
    a, b = (cut_out(circle, place, [5.0, 0.0], [25.0, 20.0], plan) for place in PLACES)
    answer = align(a, b, None, config(method))
    assert isinstance(answer, NoStitch)
    assert ("no directions" if method in ("carpin", "censi") else "features") in answer.reason


@pytest.mark.parametrize("method", ["carpin", "akaze", "orb"])
def test_strangers_are_refused_with_figures(strangers: tuple[Submap, Submap], method: str) -> None:
    answer = align(*strangers, None, config(method))
    assert isinstance(answer, NoStitch)
    assert "expected at least" in answer.reason
    assert answer.best is not None


@pytest.mark.parametrize("method", ["carpin", "censi", "akaze", "orb"])
def test_a_prior_excludes(most: tuple[Submap, Submap], method: str) -> None:
    turned_round = Prior(T_TRUE + np.array([0.0, 0.0, np.pi]), np.diag([2.0, 2.0, 0.1]) ** 2)
    near = Prior(T_TRUE + np.array([0.5, 0.0, 0.1]), np.diag([1.0, 1.0, 0.1]) ** 2)
    assert isinstance(align(*most, near, config(method)), Stitch)
    far = Prior(T_TRUE + np.array([60.0, 60.0, 0.0]), np.diag([1.0, 1.0, 0.1]) ** 2)
    refused = align(*most, far, config(method))
    assert isinstance(refused, NoStitch)
    assert "prior" in refused.reason
    answer = align(*most, turned_round, config(method))
    if isinstance(answer, Stitch):  # censi has solutions everywhere, and no test of them
        assert method == "censi"
        assert abs(float(se2.wrap(answer.T_a_b[2] - T_TRUE[2]))) > 2.5


def test_the_thesis_chooses_among_four_rotations_in_whole_degrees(most: tuple[Submap, Submap]) -> None:
    maps = Pair(*most, config("htms"))
    four = np.degrees([found.T_a_b[2] for found in four_hypotheses(maps)])
    np.testing.assert_allclose(four, np.round(four), atol=1e-9)
    np.testing.assert_allclose(np.diff(np.sort(four)), 90.0)
    for expected in four:
        told_so = Prior(np.array([0.0, 0.0, np.radians(expected + 20.0)]), np.eye(3))
        answer = align(*most, told_so, config("htms"))
        assert isinstance(answer, Stitch)
        assert np.degrees(answer.T_a_b[2]) == pytest.approx(expected)
        assert len(answer.alternatives) == 3
    alone = align(*most, None, config("htms"))
    assert isinstance(alone, Stitch)
    assert abs(alone.T_a_b[2]) == pytest.approx(np.radians(np.abs(four).min()))


def test_carpin_takes_the_best_acceptance_index(most: tuple[Submap, Submap]) -> None:
    answer = align(*most, None, config("carpin"))
    assert isinstance(answer, Stitch)
    cells_a = redraw(most[0].grid, np.zeros(3), SIDE)
    omegas = [
        acceptance_index(cells_a, redraw(most[1].grid, T, SIDE))
        for T in (answer.T_a_b, *(other.T_a_b for other in answer.alternatives))
    ]
    assert omegas[0] == answer.score == max(omegas)
    assert omegas == sorted(omegas, reverse=True)


def cells(rows: list[str], first: tuple[int, int]) -> Raster:
    drawn = np.array([list(row) for row in rows])
    return Raster(drawn == "#", drawn == ".", np.array(first, dtype=float), SIDE)


def test_acceptance_index_by_hand() -> None:
    a = cells(["#..", "#. ", "###"], (0, 0))
    b = cells(["..", "#.", "# "], (1, 0))  # its left column is a's middle one
    #  agree: ".", ".", "#"      disagree: "#" on "."      unknown: " " and " " (twice)
    assert acceptance_index(a, b) == pytest.approx(3.0 / 4.0)
    assert acceptance_index(a, cells(["#"], (3, 0))) == 0.0
    assert acceptance_index(a, cells([" "], (1, 1))) == 0.0
    assert acceptance_index(a, a) == 1.0


def test_redrawing_keeps_walls_closed() -> None:
    """A slanting wall of one cell, finer and coarser: no hole, and nothing in the free space beside it."""
    occupied = np.zeros((30, 40), dtype=bool)
    occupied[np.arange(40) // 2 + 4, np.arange(40)] = True
    grid = Grid(occupied, ~occupied, np.array([-1.3, 0.4]), 0.1)
    for resolution in (0.04, 0.1, 0.23):
        again = redraw(grid, np.array([2.0, -1.0, 0.6]), resolution)
        assert not np.any(again.occupied & again.free)
        there = se2.transform(np.array([2.0, -1.0, 0.6]), grid.occupied_points())
        column, row = (np.floor(there / resolution) - again.first).astype(int).T
        assert np.all(again.occupied[row, column])
        share = again.occupied.sum() * resolution**2 / (40 * 0.1**2)
        assert 0.9 < share < (1.3 if resolution < 0.1 else 3.5)


def test_lags_by_hand() -> None:
    a = np.array([0.05, 0.05, 0.05, 1.05, 1.05])
    b = np.array([5.05, 5.05, 6.05])
    shifts, scores = lags(a, b, 0.1, 3)
    np.testing.assert_allclose(shifts, [-5.0, -4.0, -6.0], atol=1e-9)
    np.testing.assert_allclose(scores, [3 * 2 + 2, 2 * 2, 3])


def honeycomb() -> np.ndarray:
    """Part of a beehive, out of round so that it fits itself in one way only."""
    walls = []
    for row, column in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 1), (2, 3), (3, 0)):
        centre = 2.0 * np.array([np.sqrt(3.0) * (column + 0.5 * (row % 2)), 1.5 * row])
        angles = np.arange(7) * np.pi / 3.0
        corner = centre + 2.0 * np.stack([np.sin(angles), np.cos(angles)], -1)
        walls += [[*corner[k], *corner[k + 1]] for k in range(6)]
    return on(np.array(walls))


def test_censi_uses_as_many_directions_as_there_are(plan: dict[str, Any]) -> None:
    comb = honeycomb()
    a, b = (cut_out(comb, place, [-4.0, -4.0], [14.0, 14.0], plan) for place in PLACES)
    maps = Pair(a, b, config("censi"))
    directions = common_directions(*maps.spectra(360, split=True), T_TRUE[2], 3, DirectionConfig())
    expected = PLACES[0, 2] + np.radians([0.0, 60.0, 120.0])  # normals, in a's frame: turned back
    off = (directions + 2.0 * PLACES[0, 2] - expected[:, None]) % (np.pi / 3.0)
    np.testing.assert_allclose(np.minimum(off, np.pi / 3.0 - off), 0.0, atol=np.radians(1.0))
    best = max(solutions(maps, float(T_TRUE[2]), directions), key=lambda found: found.score)
    assert error(T_TRUE, best.T_a_b)[0] < 0.05
    answer = align(a, b, Prior(T_TRUE, np.diag([2.0, 2.0, 0.2]) ** 2), config("censi"))
    assert isinstance(answer, Stitch)
    assert error(T_TRUE, answer.T_a_b)[0] < 0.05


def test_a_translation_explains_the_lags_of_all_directions(plan: dict[str, Any]) -> None:
    """With three directions and two unknowns most combinations of lags contradict themselves."""
    a, b = (cut_out(honeycomb(), place, [-4.0, -4.0], [14.0, 14.0], plan) for place in PLACES)
    maps = Pair(a, b, config("censi"))
    directions = np.radians([0.0, 60.0, 120.0]) - PLACES[0, 2]
    found = solutions(maps, float(T_TRUE[2]), directions)
    assert 0 < len(found) < 60  # of 125
    turned = maps.walls_b @ se2.rotation(T_TRUE[2]).T
    for angle in directions:
        u = np.array([np.cos(angle), np.sin(angle)])
        shifts, _ = lags(maps.walls_a @ u, turned @ u, SIDE, 5)
        for solution in found:
            assert np.abs(shifts - solution.T_a_b[:2] @ u).min() <= 3.0 * SIDE + 1e-9


def test_a_prior_lets_censi_find_what_the_highest_peaks_miss(floor: np.ndarray, plan: dict[str, Any]) -> None:
    """A third in common: the X and Y spectra's best lags are false, the true ones are among the next."""
    a = cut_out(floor, PLACES[0], [-1.0, -1.0], [20.0, 21.0], plan)
    b = cut_out(floor, PLACES[1], [10.0, -1.0], [31.0, 21.0], plan)
    prior = Prior(T_TRUE + np.array([0.5, -0.5, 0.1]), np.diag([1.0, 1.0, 0.15]) ** 2)
    by_peaks, censi = (align(a, b, prior, config(method)) for method in ("htms", "censi"))
    assert isinstance(by_peaks, Stitch)
    assert error(T_TRUE, by_peaks.T_a_b)[0] > 5.0
    assert isinstance(censi, Stitch)
    assert error(T_TRUE, censi.T_a_b)[0] < 0.06


def test_reasons_against_directions() -> None:
    flat, one, two = np.ones(180), np.full(180, 0.01), np.full(180, 0.05)
    one[[40, 41]] = 1.0
    two[[40, 130]] = 1.0, 0.5
    assert "submap a have no directions" in str(reason_against_directions(flat, two, DirectionConfig()))
    assert "submap b have one direction" in str(reason_against_directions(two, one, DirectionConfig()))
    assert reason_against_directions(two, two, DirectionConfig()) is None


def test_a_rigid_transform_is_found_among_false_matches() -> None:
    rng = np.random.default_rng(0)
    b = rng.uniform(-10.0, 10.0, (80, 2))
    a = se2.transform(T_TRUE, b) + rng.normal(0.0, 0.02, b.shape)
    a[30:] = rng.uniform(-20.0, 20.0, (50, 2))
    fitted = fit_rigid(a, b, AlignConfig())
    assert fitted is not None
    assert fitted[1] >= 30
    assert error(T_TRUE, fitted[0])[0] < 0.05
    assert error(T_TRUE, fitted[0])[1] < 0.1


def test_scale_and_mirror_are_not_rigid() -> None:
    b = np.random.default_rng(1).uniform(-10.0, 10.0, (60, 2))
    strict = AlignConfig(features=FeatureConfig(reach=1.0))
    for a in (1.3 * b, b * [1.0, -1.0]):
        fitted = fit_rigid(a, b, strict)
        assert fitted is None or fitted[1] < 15
    assert fit_rigid(b[:2], 3.0 * b[:2], strict) is None
