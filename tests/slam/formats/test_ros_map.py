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
        ("0.5", ".nan", "resolution is '.nan', expected a number"),
        ("origin: [-1.0, 2.0, 0.0]\n", "", "no origin"),
        ("2.0, 0.0", "2.0", r"origin is \[-1.0, 2.0\], expected \[x, y, yaw\]"),
        ("2.0, 0.0", "2.0, 0.1", "origin is rotated by 0.1 rad"),
        ("0.196", "0.9", "free_thresh 0.9, occupied_thresh 0.65, expected"),
        ("negate: 0\n", "", "no negate"),
        ("negate: 0\n", "negate: 0\nmode: grey\n", "mode 'grey', expected trinary, scale, raw"),
        ("map.pgm", "[map.pgm]", r"no image, expected the name of one, got \['map.pgm'\]"),
        ("map.pgm", "''", "no image, expected the name of one"),
        ("-1.0", "[" * 5000, r"nested too deeply|map\.yaml:\d: not yaml"),
        ("0.5", "9" * 5000, "resolution is '9+.*9+', expected a number"),
        ("-1.0, 2.0", "1.0e+300, 2.0", r"origin is .*, expected metres within ±1e\+08"),
    ],
)
def test_bad_yaml(folder: Path, old: str, new: str, message: str) -> None:
    (folder / "map.yaml").write_text(YAML.replace(old, new))
    with pytest.raises(FormatError, match=message) as caught:
        ros_map.read(folder / "map.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not an image, expected pgm, png, bmp, jpg or tif"),
        (b"hello", "not an image, expected pgm, png, bmp, jpg or tif"),
        (b"P5\n3 2\n255\n\x00\x01", "a torn image, expected a complete one"),
        (b"\x89PNG\r\n\x1a\n", "not an image, expected pgm, png, bmp, jpg or tif"),
        (b"P5\n0 0\n255\n", "a torn image, expected a complete one"),
    ],
)
def test_torn_image(folder: Path, data: bytes, message: str, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "map.pgm").write_bytes(data)
    with pytest.raises(FormatError, match=rf"map\.pgm: {message}"):
        ros_map.read(folder / "map.yaml")
    assert capfd.readouterr().err == ""


def image(folder: Path, pixels: np.ndarray, **changes: str) -> Grid:
    """The map of one PNG with these pixels, channels in the order blue, green, red, alpha."""
    import cv2

    assert cv2.imwrite(str(folder / "map.png"), pixels)
    text = YAML.replace("map.pgm", "map.png").replace("negate: 0", f"negate: {changes.get('negate', '0')}")
    text = text.replace("0.196", changes.get("free_thresh", "0.196"))
    (folder / "map.yaml").write_text(text + f"mode: {changes.get('mode', 'trinary')}\n")
    return ros_map.read(folder / "map.yaml")


def test_colours_count_by_their_mean(folder: Path) -> None:
    # means 85, 170, 254: occupancies 0.67, 0.33, 0.004
    grid = image(folder, np.array([[[0, 0, 255], [255, 0, 255], [254, 254, 254]]], dtype=np.uint8))
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 1]])


RGBA = np.array([[[0, 0, 0, 255], [255, 255, 255, 0], [255, 255, 255, 255], [0, 0, 0, 0]]], dtype=np.uint8)


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_alpha_is_no_colour_and_what_is_not_opaque_is_unknown(folder: Path, mode: str) -> None:
    grid = image(folder, RGBA, mode=mode)
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[0, 0, 1, 0]])


SAVED = np.array([[0, 205, 254], [205, 254, 205]], dtype=np.uint8)
"""As map_saver has it."""


@pytest.mark.parametrize("unknown", [205, 206])
@pytest.mark.parametrize("free_thresh", ["0.196", "0.25", "0.6"])
def test_the_savers_greys_mean_what_it_means_by_them(folder: Path, free_thresh: str, unknown: int) -> None:
    """205 is an occupancy of 0.196, so nav2's own threshold of 0.25 would have everything unknown free."""
    saved = np.where(SAVED == 205, unknown, SAVED).astype(np.uint8)
    grid = image(folder, saved, free_thresh=free_thresh)
    np.testing.assert_array_equal(grid.occupied, saved[::-1] == 0)
    np.testing.assert_array_equal(grid.free, saved[::-1] == 254)
    inverted = image(folder, 255 - saved, free_thresh=free_thresh, negate="1")
    np.testing.assert_array_equal(inverted.free, grid.free)


def test_other_greys_mean_what_the_thresholds_say(folder: Path) -> None:
    """A fifth of the pixels is none of the saver's: 205 is a probability like any other."""
    grey = np.array([[0, 205, 254, 180, 254, 205, 0, 254, 100, 205]], dtype=np.uint8)
    np.testing.assert_array_equal(image(folder, grey, free_thresh="0.25").free, grey >= 205)


def test_mode_raw_has_per_cent(folder: Path) -> None:
    grid = image(folder, np.array([[0, 100, 255, 66, 19, 40, 101]], dtype=np.uint8), mode="raw")
    np.testing.assert_array_equal(grid.occupied, [[0, 1, 0, 1, 0, 0, 0]])
    np.testing.assert_array_equal(grid.free, [[1, 0, 0, 0, 1, 0, 0]])


@pytest.mark.parametrize("suffix", [".bmp", ".jpg", ".tif", ".png", ".JPG"])
def test_other_kinds_of_images(folder: Path, suffix: str) -> None:
    import cv2

    pixels = np.kron(SAVED, np.ones((16, 16), dtype=np.uint8))
    assert cv2.imwrite(str(folder / f"map{suffix}"), pixels)
    (folder / "map.yaml").write_text(YAML.replace("map.pgm", f"map{suffix}") + "mode: Trinary\n")
    grid = ros_map.read(folder / "map.yaml")
    np.testing.assert_array_equal(grid.occupied, pixels[::-1] == 0)
    np.testing.assert_array_equal(grid.free, pixels[::-1] == 254)


def test_a_header_with_dos_line_ends_shifts_nothing(folder: Path) -> None:
    (folder / "map.pgm").write_bytes(b"P5\r\n3 2\r\n255\r\n" + SAVED.tobytes())
    np.testing.assert_array_equal(ros_map.read(folder / "map.yaml").occupied, SAVED[::-1] == 0)


@pytest.mark.parametrize("white", [100, 254, 1000])
@pytest.mark.parametrize("kind", [b"P2", b"P5"])
def test_white_is_what_the_header_says(folder: Path, white: int, kind: bytes) -> None:
    values = np.round(SAVED / 255.0 * white).astype(">u1" if white < 256 else ">u2")
    body = values.tobytes() if kind == b"P5" else b" ".join(b"%d" % value for value in values.ravel())
    (folder / "map.pgm").write_bytes(b"%s\n3 2\n%d\n" % (kind, white) + body)
    grid = ros_map.read(folder / "map.yaml")
    np.testing.assert_array_equal(grid.occupied, SAVED[::-1] == 0)
    np.testing.assert_array_equal(grid.free, SAVED[::-1] == 254)


@pytest.mark.parametrize(
    "named", ["/home/robot/maps/map.pgm", r"C:\maps\map.pgm", "maps/map.pgm", "~/map.pgm", "MAP.PGM"]
)
def test_an_image_of_another_computers_path_lies_beside_the_yaml(folder: Path, named: str) -> None:
    (folder / "map.yaml").write_text(YAML.replace("map.pgm", named))
    found = ros_map.read_map(folder / "map.yaml")
    assert found.image == folder / "map.pgm" == ros_map.image_of(folder / "map.yaml")
    assert [note.split(": ", 1)[1] for note in found.notes] == [
        f"image {named} is not there, map.pgm beside the yaml is used"
    ]


def test_a_map_that_states_no_unknown_cell_says_so(folder: Path) -> None:
    assert ros_map.read_map(folder / "map.yaml").notes == ()
    (folder / "map.pgm").write_bytes(b"P1\n3 2\n1 0 0\n0 0 0\n")  # one bit: black or white
    found = ros_map.read_map(folder / "map.yaml")
    assert not found.states_unknown
    assert "no cell is unknown" in found.notes[0]


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


def test_a_rotated_origin_is_the_pose_of_the_lower_left_corner(folder: Path) -> None:
    (folder / "map.yaml").write_text(YAML.replace("2.0, 0.0", "2.0, 0.5"))
    found = ros_map.read_map(folder / "map.yaml")
    np.testing.assert_array_equal(found.grid.occupied, [[0, 0, 0], [1, 0, 0]])
    assert found.grid.origin.tolist() == [0.0, 0.0]
    assert found.T_map_grid.tolist() == [-1.0, 2.0, 0.5]


def test_round_trip_of_a_rotated_map(tmp_path: Path) -> None:
    occupied = np.array([[True, False], [False, False], [False, True]])
    grid = Grid(occupied, ~occupied, np.array([3.0, -4.0]), 0.25)
    ros_map.write(tmp_path / "map.yaml", grid, yaw=-2.0)
    found = ros_map.read_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(found.grid.occupied, occupied)
    assert found.T_map_grid.tolist() == [3.0, -4.0, -2.0]


def test_a_map_is_named_after_its_yaml(tmp_path: Path) -> None:
    cells = np.zeros((2, 2), dtype=bool)
    with pytest.raises(ValueError, match=r"expected NAME\.yaml"):
        ros_map.write(tmp_path / "map.pgm", Grid(cells, cells, np.zeros(2), 0.1))
