"""ROS maps: which way up, what the grey values mean, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam.formats import FormatError, ros_map
from slam.occupancy import Grid

YAML = """image: map.pgm
resolution: 0.5
origin: [-1.0, 2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PGM = b"P2\n3 2\n255\n0 254 205\n205 205 254\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "map.yaml").write_text(YAML)
    (tmp_path / "map.pgm").write_bytes(PGM)
    return tmp_path


def test_top_row_of_the_image_is_the_largest_y(folder: Path) -> None:
    grid = ros_map.read(folder / "map.yaml")
    np.testing.assert_array_equal(grid.occupied, [[0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 1], [0, 1, 0]])
    assert grid.origin.tolist() == [-1.0, 2.0]
    assert grid.resolution == 0.5


def test_written_pixels_by_hand(tmp_path: Path) -> None:
    occupied = np.array([[False, False, False], [True, False, False]])
    free = np.array([[False, False, True], [False, True, False]])
    ros_map.write(tmp_path / "map.yaml", Grid(occupied, free, np.array([-1.0, 2.0]), 0.5))
    header, pixels = (tmp_path / "map.pgm").read_bytes()[:-6], (tmp_path / "map.pgm").read_bytes()[-6:]
    assert header == b"P5\n3 2\n255\n"
    assert list(pixels) == [0, 254, 205, 205, 205, 254]
    assert "image: 'map.pgm'" in (tmp_path / "map.yaml").read_text()


def test_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    state = rng.integers(0, 3, (17, 30))
    grid = Grid(state == 1, state == 2, np.array([-12.35, 1e-17]), 0.05)
    ros_map.write(tmp_path / "it's a map.yaml", grid)
    found = ros_map.read(tmp_path / "it's a map.yaml")
    np.testing.assert_array_equal(found.occupied, grid.occupied)
    np.testing.assert_array_equal(found.free, grid.free)
    np.testing.assert_array_equal(found.origin, grid.origin)
    assert found.resolution == grid.resolution


def test_png_and_negate(folder: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    assert cv2.imwrite(str(folder / "map.png"), np.array([[255, 1, 50]], dtype=np.uint8))
    (folder / "map.yaml").write_text(YAML.replace("map.pgm", "map.png").replace("negate: 0", "negate: 1"))
    grid = ros_map.read(folder / "map.yaml")
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 1, 0]])  # 50/255 is neither


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (YAML, "", "empty"),
        (YAML, "- 1\n", "not a map"),
        (YAML, "image: [\n", r"map\.yaml:2: not yaml"),
        ("image: map.pgm\n", "", "no image, expected"),
        ("map.pgm", "other.pgm", r"image other\.pgm not found"),
        ("map.pgm", "map.yaml", r"map\.yaml: not an image"),
        ("resolution: 0.5\n", "", "no resolution"),
        ("0.5", "0", "resolution 0, expected metres per pixel > 0"),
        ("0.5", "-0.5", "resolution -0.5, expected"),
        ("0.5", "fine", "resolution is 'fine', expected a number"),
        ("0.5", ".nan", "resolution is nan, expected a number"),
        ("origin: [-1.0, 2.0, 0.0]\n", "", "no origin"),
        ("2.0, 0.0", "2.0", r"origin is \[-1.0, 2.0\], expected \[x, y, yaw\]"),
        ("2.0, 0.0", "2.0, 0.1", "origin is rotated by 0.1 rad"),
        ("0.196", "0.9", "free_thresh 0.9, occupied_thresh 0.65, expected"),
        ("negate: 0\n", "", "no negate"),
        ("negate: 0\n", "negate: 0\nmode: scale\n", "mode 'scale', expected trinary"),
    ],
)
def test_bad_yaml(folder: Path, old: str, new: str, message: str) -> None:
    (folder / "map.yaml").write_text(YAML.replace(old, new))
    with pytest.raises(FormatError, match=message) as caught:
        ros_map.read(folder / "map.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [b"", b"P5\n3 2\n255\n\x00\x01", b"hello"])
def test_torn_image(folder: Path, data: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "map.pgm").write_bytes(data)
    with pytest.raises(FormatError, match=r"map\.pgm: not an image, expected pgm or png"):
        ros_map.read(folder / "map.yaml")
    assert capfd.readouterr().err == ""


def test_a_map_is_named_after_its_yaml(tmp_path: Path) -> None:
    cells = np.zeros((2, 2), dtype=bool)
    with pytest.raises(ValueError, match=r"expected NAME\.yaml"):
        ros_map.write(tmp_path / "map.pgm", Grid(cells, cells, np.zeros(2), 0.1))
