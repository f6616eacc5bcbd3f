"""The worked examples of the thesis, drawn from shapes of our own, have the answers they were drawn with."""

from __future__ import annotations

import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

from scenarios.report import __main__ as command
from scenarios.report import chapter3
from scenarios.report.chapter3 import points_on, rasterise_points
from slam import se2
from stitch import NoStitch, Prior, Stitch, align
from stitch.alignment import hough
from stitch.alignment.hough import cross_correlation, hypotheses
from stitch.alignment.translation import by_spectra, profile
from stitch.published.htms import DIRECTIONS, dominant_direction, four_hypotheses


def spectrum(points: np.ndarray) -> np.ndarray:
    return hough.spectrum(chapter3.transform(points))


def tops(signal: np.ndarray, count: int) -> list[int]:
    """The best local maxima of a circular signal, at least 20 bins apart, in order of their bins."""
    found: list[int] = []
    for k in np.argsort(-signal, kind="stable"):
        if all(min((k - f) % len(signal), (f - k) % len(signal)) >= 20 for f in found):
            found.append(int(k))
    return sorted(found[:count])


def test_two_lines_are_two_points() -> None:
    """Figure 3.1: at 0° and 45°; the third maximum, at 180°, is that at 0°."""
    found = chapter3.transform(points_on(chapter3.lines()))
    for angle, rho in ((0, 1.5), (45, 0.5)):
        column = found.votes[angle]
        at = found.first + found.resolution * int(np.argmax(column))
        assert at == pytest.approx(rho, abs=chapter3.PIXEL)
        assert column.max() > 0.6 * np.delete(found.votes, [0, 1, 44, 45, 46, 179], axis=0).max() + 10
    last = found.first + found.resolution * int(np.argmax(found.votes[-1]))
    assert last == pytest.approx(-1.5, abs=chapter3.PIXEL)


def test_rooms_have_two_directions() -> None:
    """Figure 3.2."""
    of_rooms = spectrum(points_on(chapter3.rooms()))
    assert tops(of_rooms, 2) == [0, 90]
    assert np.delete(of_rooms, np.r_[0:10, 80:101, 170:180]).max() < 0.15


def test_a_beehive_has_three() -> None:
    """Figure 3.3: at 60° from each other, well above all others."""
    of_hexagons = spectrum(points_on(chapter3.hexagons()))
    assert tops(of_hexagons, 3) == [0, 60, 120]
    assert of_hexagons[[0, 60, 120]].min() > 1.3 * of_hexagons[[30, 90, 150]].max()


@pytest.mark.parametrize("degrees", [0, 30, 90, 137])
def test_the_correlation_tells_how_far_the_lines_were_turned(degrees: int) -> None:
    """Figure 3.4: at 90°, with smaller peaks 45° to either side."""
    points = points_on(chapter3.lines())
    correlation = cross_correlation(spectrum(chapter3.rotate(points, np.radians(degrees))), spectrum(points))
    best = int(np.argmax(correlation))
    assert min((best - degrees) % 180, (degrees - best) % 180) <= 1
    beside = correlation[[(degrees + 45) % 180, (degrees - 45) % 180]]
    assert np.all(beside < 0.85 * correlation[best])
    assert np.all(beside > 1.1 * correlation[(degrees + 90) % 180])


@pytest.mark.parametrize("degrees", [60, -60, 20, 160])
def test_a_turned_beehive_is_turned_back(degrees: int) -> None:
    """Rotation is known but for its six-fold symmetry, translation exactly for the right one of six."""
    points = points_on(chapter3.hexagons()[5:])  # without one corner of the comb it fits one way only
    T_a_b = np.array([2.0, -3.0, np.radians(degrees)])
    a, b = (
        rasterise_points(points),
        rasterise_points(se2.transform(se2.inverse(T_a_b), points)),
    )
    walls_a, walls_b = a.grid.occupied_points(), b.grid.occupied_points()
    spectrum_a, spectrum_b = spectrum(walls_a), spectrum(walls_b)
    angles, _ = hypotheses(spectrum_a, spectrum_b, 3, np.radians(10.0), 0.0)
    off = np.degrees(np.abs(se2.wrap(angles - T_a_b[2])))
    assert off.min() <= 1.0
    np.testing.assert_allclose(np.round(off / 60.0) * 60.0, off, atol=1.0)
    right = float(angles[np.argmin(off)])
    t, _ = by_spectra(walls_a, walls_b, right, dominant_direction(spectrum_a), chapter3.PIXEL)
    np.testing.assert_allclose(t, T_a_b[:2], atol=0.12)


def test_spectra_show_walls_only_along_the_dominant_direction() -> None:
    """Figures 3.5 and 3.6."""
    points = rasterise_points(points_on(chapter3.rooms())).grid.occupied_points()
    along_x, first = profile(points[:, 0], chapter3.PIXEL)
    walls = first + np.flatnonzero(along_x > 0.4 * 160)
    np.testing.assert_allclose(chapter3.PIXEL * walls, [0.0, 3.4, 8.15, 12.0], atol=chapter3.PIXEL)
    skew, _ = profile(chapter3.rotate(points, np.radians(20.0))[:, 0], chapter3.PIXEL)
    assert skew.max() < 0.1 * along_x.max()


def test_the_cut_out_has_four_hypotheses_and_the_third_is_right() -> None:
    """Figures 3.8 and 3.11: 169° is the highest peak, 79° the second and right, as in the thesis."""
    maps = chapter3.example()
    assert dominant_direction(maps.spectra(DIRECTIONS, split=False)[0]) == pytest.approx(np.pi / 2)
    found = four_hypotheses(maps)
    degrees = [float(np.degrees(hypothesis.T_a_b[2])) for hypothesis in found]
    np.testing.assert_allclose(degrees, [169.0, -11.0, 79.0, -101.0])
    off = [chapter3.distance_from_truth(hypothesis) for hypothesis in found]
    assert off[2][0] < 0.05
    assert off[2][1] < 0.5
    assert min(metres for k, (metres, _) in enumerate(off) if k != 2) > 1.0


def test_the_inertial_sensor_chooses() -> None:
    """Section 3.6: the hypothesis nearest its rotation; without one, the smallest rotation."""
    a, b = chapter3.map_and_cutout()
    told = Prior(np.array([0.0, 0.0, np.radians(60.0)]), np.eye(3))
    answer = align(a, b, told, chapter3.CONFIG)
    assert isinstance(answer, Stitch)
    np.testing.assert_allclose(answer.T_a_b, chapter3.T_MAP_CUTOUT, atol=0.05)
    assert answer.covariance is None
    alone = align(a, b, None, chapter3.CONFIG)
    assert isinstance(alone, Stitch)
    assert np.degrees(alone.T_a_b[2]) == pytest.approx(-11.0)
    assert not isinstance(alone, NoStitch)


def test_the_command_draws_every_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "chapter3"
    command.run(command.Options(("chapter3",), out))
    assert capsys.readouterr().out.strip() == str(out)
    assert {path.stem for path in out.iterdir()} == set(chapter3.PICTURES)
    for path in out.iterdir():
        picture = cv2.imread(str(path))
        assert picture.shape[1] == 1320
        assert picture.std() > 5.0


@pytest.mark.parametrize("name", [*command.PICTURES, *command.OF_FOLDERS])
def test_every_report_can_be_run(name: str) -> None:
    module = (command.PICTURES | command.OF_FOLDERS)[name]
    assert callable(import_module(f"scenarios.report.{module}").run)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["chapter4", "-o", "x"], "unknown report 'chapter4': did you mean 'chapter3'?"),
        (["chapter3"], "-o: expected where to write chapter3"),
        ([], "or one of chapter3"),
        (["chapter3", "-o", "/proc/none"], "--out /proc/none: cannot be written"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], complaint: str, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["report", *arguments])
    assert command.main(command.Options, command.COMMAND, command.run) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1


def test_bad_input_from_the_shell_is_exit_code_2() -> None:
    command = [sys.executable, "-m", "scenarios.report", "chapter4"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_help_is_instant() -> None:
    started = time.perf_counter()
    shown = subprocess.run(
        [sys.executable, "-m", "scenarios.report", "--help"], capture_output=True, text=True, check=True
    )
    assert time.perf_counter() - started < 3.0  # a fifth of a second on an idle machine
    assert "chapter3" in shown.stdout
    slow = "{'numba', 'matplotlib', 'cv2'} & set(sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", f"import sys, scenarios.report.__main__; print(list({slow}))"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert loaded.stdout.strip() == "[]"
