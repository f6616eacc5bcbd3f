"""python -m stitch: what cannot be used is told in one clear line, with exit code 2 and nothing written."""

from __future__ import annotations

import contextlib
import io
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from slam.formats import ros_map
from slam.mapping.occupancy import Grid


def run_command(*words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of ``python -m stitch WORDS``."""
    from slam.cli import main
    from stitch.__main__ import COMMAND, Options, run

    stdout, stderr = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["stitch", *map(str, words)])
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            code = main(Options, COMMAND, run)
    return code, stdout.getvalue(), stderr.getvalue()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with maps good.yaml and fair.yaml of a small room."""
    occupied = np.zeros((40, 60), dtype=bool)
    occupied[[2, 37]] = occupied[:, [2, 57]] = True
    for name in ("good", "fair"):
        ros_map.write(tmp_path / f"{name}.yaml", Grid(occupied, ~occupied, np.zeros(2), 0.1))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def bad(folder: Path, old: str, new: str) -> None:
    """bad.yaml: good.yaml with a change."""
    text = (folder / "good.yaml").read_text()
    assert re.search(old, text)
    (folder / "bad.yaml").write_text(re.sub(old, new, text, count=1))


def check(folder: Path, message: str, *words: object) -> None:
    before = sorted(folder.rglob("*"))
    code, stdout, stderr = run_command(*words)
    assert (code, stdout) == (2, "")
    assert re.fullmatch(f"stitch: [^\n]*{message}[^\n]*\n", stderr), stderr
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (r"(?s).*", "", r"bad\.yaml: the file is empty"),
        (r"(?s).*", "image: [\n", r"bad\.yaml:2: not yaml"),
        ("good.pgm", "nowhere.pgm", r"bad\.yaml: image nowhere\.pgm not found beside the yaml"),
        ("resolution: .*", "resolution: 0", r"bad\.yaml: resolution 0, expected metres per pixel > 0"),
        ("resolution: .*", "resolution: .nan", r"resolution is '.nan', expected a number"),
        ("origin: .*", "", "no origin, expected"),
        ("origin: .*", "origin: [.inf, 0, 0]", r"origin is '\.inf', expected a number"),
        ("occupied_thresh: .*", "occupied_thresh: 1.0", r"bad\.yaml: 0 occupied of 60 x 40 cells, expected"),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_bad_map(folder: Path, first: bool, old: str, new: str, message: str) -> None:
    bad(folder, old, new)
    names = ["bad.yaml", "good.yaml"] if first else ["good.yaml", "bad.yaml"]
    check(folder, message, *names, "-o", "new/merged")


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (b"P5 1 1 255\n\x00", "1 occupied of 1 x 1 cells, expected at least 10"),
        (b"P5 20000 20000 255\n", r"20000 x 20000 pixels would take 2\.0 GB of memory, expected at most"),
        (b"hello", r"good\.pgm: not an image, expected pgm, png, bmp, jpg or tif"),
    ],
)
def test_bad_image(folder: Path, pixels: bytes, message: str) -> None:
    (folder / "good.pgm").write_bytes(pixels)
    check(folder, message, "good.yaml", "fair.yaml", "-o", "merged")


def test_maps_too_large_to_be_aligned(folder: Path) -> None:
    pixels = np.full((4000, 4000), 205, dtype=np.uint8)
    pixels[[0, -1], :20] = pixels[[0, -1], -20:] = 0
    (folder / "good.pgm").write_bytes(b"P5 4000 4000 255\n" + pixels.tobytes())
    bad(folder, "resolution: .*", "resolution: 0.2")
    message = r"maps of 800 x 800 m, 6 x 4 m: aligning takes 5\.\d GB of memory, expected at most 1\.5"
    check(folder, message, "bad.yaml", "fair.yaml")


TWO = ["good.yaml", "fair.yaml"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], r"expected two maps, NAME\.yaml each, got 0"),
        (["good.yaml"], "expected two maps, .*got 1"),
        (["good.yaml", "--all"], "expected two maps, .*got 1"),
        ([*TWO, "good.yaml"], "expected two maps, got 3: with --all any number"),
        (["good.yaml", "nowhere.yaml"], r"nowhere\.yaml: no such file"),
        (["good.pgm", "fair.yaml"], r"good\.pgm: is an image, expected the map's yaml"),
        ([*TWO, "--prior", "nan", "0", "0"], "--prior: expected three finite numbers, got nan 0 0"),
        ([*TWO, "--prior", "1", "2"], "--prior"),
        ([*TWO, "--prior", "1", "2", "90"], "--prior: a yaw of 90 is more than a turn, expected radians"),
        (
            [*TWO, "--prior", "1", "2", "3", "--prior-sigma", "1", "-1", "1"],
            "--prior-sigma: expected three standard deviations > 0, got 1 -1 1",
        ),
        ([*TWO, "--prior", "1", "2", "3", "--prior-sigma", "1", "inf", "1"], "--prior-sigma: .*finite"),
        ([*TWO, "--prior-sigma", "1", "1", "1"], "--prior-sigma is for a --prior"),
        ([*TWO, "--all", "--prior", "1", "2", "3"], "--prior is for two maps, not for --all"),
        ([*TWO, "--all", "--method", "orb"], "--all .*expected --method joint, got orb"),
        ([*TWO, "--method", "sift"], "invalid choice 'sift'"),
        ([*TWO, "--metod", "orb"], r"unknown option '--metod': did you mean '--method'\?"),
        ([*TWO, "-o", "good"], r"--out good: would overwrite good\.yaml"),
        ([*TWO, "-o", "fair.png"], r"--out fair\.png: would overwrite fair\.yaml"),
        ([*TWO, "-o", "."], r"--out \.: is a folder, expected the name of a map"),
        ([*TWO, "-o", "good.pgm/merged"], r"--out good\.pgm/merged: .*good\.pgm is not a folder"),
    ],
)
def test_bad_options(folder: Path, words: list[str], message: str) -> None:
    check(folder, message, *words)


def test_the_image_of_an_input_is_safe_too(folder: Path) -> None:
    bad(folder, "nothing|image", "image")
    check(folder, "--out good.yaml: would overwrite", "bad.yaml", "fair.yaml", "-o", "good.yaml")
