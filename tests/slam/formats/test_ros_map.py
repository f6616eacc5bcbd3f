"""ROS maps: which way up, what the grey values mean, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam.formats import FormatError, ros_map
from slam.mapping.occupancy import Grid

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
    import cv2

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
        ("negate: 0\n", "negate: 0\nmode: raw\n", "mode 'raw', expected trinary or scale"),
        ("map.pgm", "[map.pgm]", r"image \['map.pgm'\] not found"),
        ("map.pgm", "''", "image not found"),
        ("-1.0, 2.0", "1.0e+300, 2.0", r"origin is .*, expected metres within ±1e\+08"),
    ],
)
def test_bad_yaml(folder: Path, old: str, new: str, message: str) -> None:
    (folder / "map.yaml").write_text(YAML.replace(old, new))
    with pytest.raises(FormatError, match=message) as caught:
        ros_map.read(folder / "map.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "data", [b"", b"P5\n3 2\n255\n\x00\x01", b"hello", b"\x89PNG\r\n\x1a\n", b"P5\n0 0\n255\n"]
)
def test_torn_image(folder: Path, data: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "map.pgm").write_bytes(data)
    with pytest.raises(FormatError, match=r"map\.pgm: not an image, expected pgm or png"):
        ros_map.read(folder / "map.yaml")
    assert capfd.readouterr().err == ""


def image(folder: Path, pixels: np.ndarray, **changes: str) -> Grid:
    """The map of one PNG with these pixels, channels in the order blue, green, red, alpha."""
    import cv2

    assert cv2.imwrite(str(folder / "map.png"), pixels)
    text = YAML.replace("map.pgm", "map.png").replace("negate: 0", f"negate: {changes.get('negate', '0')}")
    (folder / "map.yaml").write_text(text + f"mode: {changes.get('mode', 'trinary')}\n")
    return ros_map.read(folder / "map.yaml")


def test_colours_count_by_their_mean(folder: Path) -> None:
    # means 85, 170, 254: occupancies 0.67, 0.33, 0.004
    grid = image(folder, np.array([[[0, 0, 255], [255, 0, 255], [254, 254, 254]]], dtype=np.uint8))
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 1]])


RGBA = np.array([[[0, 0, 0, 255], [255, 255, 255, 0], [255, 255, 255, 255], [0, 0, 0, 0]]], dtype=np.uint8)


def test_alpha_is_one_more_channel_to_map_server(folder: Path) -> None:
    grid = image(folder, RGBA)  # means 63.75, 191.25, 255, 0: occupancies 0.75, 0.25, 0, 1
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0, 1]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 1, 0]])


def test_what_is_not_opaque_is_unknown_in_the_mode_scale(folder: Path) -> None:
    grid = image(folder, RGBA, mode="scale")
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 1, 0]])


def test_sixteen_bits(folder: Path) -> None:
    pixels = np.array([[0, 22000, 30000, 65000]], dtype=np.uint16)
    grid = image(folder, pixels)
    np.testing.assert_array_equal(grid.occupied, [[1, 1, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 0, 1]])
    grid = image(folder, pixels, negate="true")
    np.testing.assert_array_equal(grid.occupied, [[0, 0, 0, 1]])
    np.testing.assert_array_equal(grid.free, [[1, 0, 0, 0]])


@pytest.mark.parametrize(
    "header",
    [
        b"P5 # CREATOR: map_generator.cpp 0.050 m/pix\n# 20000\n20000 20000\n255\n",
        b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + (20000).to_bytes(4, "big") * 2,
    ],
)
def test_a_huge_image_is_refused_by_its_header(folder: Path, header: bytes) -> None:
    (folder / "map.pgm").write_bytes(header)
    message = r"20000 x 20000 pixels would take 2\.0 GB of memory, expected at most 100,000,000 pixels"
    with pytest.raises(FormatError, match=message):
        ros_map.read(folder / "map.yaml")


def test_white_of_another_value_is_refused(folder: Path) -> None:
    (folder / "map.pgm").write_bytes(b"P5\n3 1\n100\n\x00\x32\x64")
    with pytest.raises(FormatError, match="white is 100, expected 255 or 65535"):
        ros_map.read(folder / "map.yaml")


def test_a_rotated_origin_is_the_pose_of_the_lower_left_corner(folder: Path) -> None:
    (folder / "map.yaml").write_text(YAML.replace("2.0, 0.0", "2.0, 0.5"))
    grid, T_map_grid = ros_map.read_cells(folder / "map.yaml")
    np.testing.assert_array_equal(grid.occupied, [[0, 0, 0], [1, 0, 0]])
    assert grid.origin.tolist() == [0.0, 0.0]
    assert T_map_grid.tolist() == [-1.0, 2.0, 0.5]


def test_round_trip_of_a_rotated_map(tmp_path: Path) -> None:
    occupied = np.array([[True, False], [False, False], [False, True]])
    grid = Grid(occupied, ~occupied, np.array([3.0, -4.0]), 0.25)
    ros_map.write(tmp_path / "map.yaml", grid, yaw=-2.0)
    found, T_map_grid = ros_map.read_cells(tmp_path / "map.yaml")
    np.testing.assert_array_equal(found.occupied, occupied)
    assert T_map_grid.tolist() == [3.0, -4.0, -2.0]


def test_a_map_is_named_after_its_yaml(tmp_path: Path) -> None:
    cells = np.zeros((2, 2), dtype=bool)
    with pytest.raises(ValueError, match=r"expected NAME\.yaml"):
        ros_map.write(tmp_path / "map.pgm", Grid(cells, cells, np.zeros(2), 0.1))
