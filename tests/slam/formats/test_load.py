"""`load` tells formats apart by content, and says in one line what it cannot read."""

from __future__ import annotations

import bz2
import gzip
import lzma
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from slam.formats import FORMATS, Format, FormatError, load, packed, recording_npz, relations
from slam.formats.packed import PACKINGS
from slam.formats.text import File
from slam.recording import Laser, Recording

ZSTD = import_module(PACKINGS[b"\x28\xb5\x2f\xfd"][1])
HEADER = "# UvA Rescue Team Logfile\n"
USARSIM = HEADER + (
    "SEN {Time 1.0} {Type INS} {Name I} {Location 1.0,2.0,0.0} {Orientation 0.0,0.0,0.5}\n"
    "SEN {Time 1.0} {Type RangeScanner} {Name H} {Resolution 0.7854} {FOV 3.1416} {Range 1,2,3,4,5}\n"
)
CARMEN = f"FLASER 181 {'1.5 ' * 181}0 0 0 0 0 0 1.0 host 1.0\n"
RELATIONS = "1.0 2.0 0.5 0.25 9.0 0.1 0.2 -1.5\n# comment\n\n2.0 3.0 0 0 0 0 0 0.125\n"


PACK = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress, "zst": ZSTD.compress}


@pytest.mark.parametrize("name", ["a.log", "a.txt", "a", "a.log.gz", "a.log.bz2", "a.log.xz", "a.txt.zst"])
@pytest.mark.parametrize(("text", "beams"), [(USARSIM, 5), (CARMEN, 181)])
def test_format_is_recognised_by_content_not_by_name(
    tmp_path: Path, name: str, text: str, beams: int
) -> None:
    path = tmp_path / name
    path.write_bytes(PACK.get(name.rpartition(".")[2], bytes)(text.encode()))
    recording = load(path)
    assert recording.ranges.shape == (1, beams)
    assert recording.name == "a"
    assert len(load(str(path))) == 1


# On arrival: every registered format


@pytest.mark.parametrize("name", [name for name, form in FORMATS.items() if form.write])
def test_what_a_format_writes_it_alone_recognises_and_reads(name: str, tmp_path: Path) -> None:
    if name == "rosbag":
        pytest.importorskip("rosbags")
    given = Recording(
        name="drive",
        time=1.0 + np.arange(3.0),
        ranges=np.array([[1.0, 2.0, np.nan, 2.5], [1.1, 2.0, 3.0, 2.5], [1.2, 2.0, 3.0, np.nan]]),
        angles=np.linspace(-1.2, 1.2, 4),
        laser=Laser(),
        dead_reckoning=np.array([[0.0, 0.0, 0.0], [0.5, 0.1, 0.1], [1.0, 0.2, 0.3]]),
    )
    path = tmp_path / "drive"
    FORMATS[name].write(path, given)  # type: ignore[misc]  # it has one
    recognising = next(other for other, form in FORMATS.items() if form.recognise(File(path)))
    assert recognising == name
    found = load(path)
    assert (found.name, found.source) == ("drive", "odometry")
    np.testing.assert_allclose(found.time, given.time, atol=1e-6)
    np.testing.assert_allclose(found.ranges, given.ranges, atol=1e-3)
    np.testing.assert_allclose(found.angles, given.angles, atol=1e-6)
    np.testing.assert_allclose(found.dead_reckoning, given.dead_reckoning, atol=1e-6)


@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_every_format_refuses_what_is_not_its_own_in_one_line(form: Format, tmp_path: Path) -> None:
    if form is FORMATS["rosbag"]:
        pytest.importorskip("rosbags")
    (tmp_path / "diary.txt").write_text("dear diary\n")
    assert not form.recognise(File(tmp_path / "diary.txt"))
    with pytest.raises(FormatError) as caught:
        form.read(File(tmp_path / "diary.txt"))
    assert str(caught.value).startswith(f"{tmp_path / 'diary.txt'}:")
    assert "\n" not in str(caught.value)


def test_line_ends_of_windows(tmp_path: Path) -> None:
    for text in (USARSIM, CARMEN):
        (tmp_path / "a.log").write_bytes(text.replace("\n", "\r\n").encode())
        (tmp_path / "b.log").write_bytes(text.encode())
        np.testing.assert_array_equal(load(tmp_path / "a.log").ranges, load(tmp_path / "b.log").ranges)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_of_windows(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.log").write_bytes(f"# Größe\n{USARSIM}".encode(encoding))
    assert load(tmp_path / "a.log").ranges.shape == (1, 5)


def test_what_unpacks_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed, "MAX_BYTES", 1000)
    (tmp_path / "a.log.gz").write_bytes(gzip.compress(bytes(10_000)))
    with pytest.raises(FormatError, match="compressed with gzip, more than 1,000 bytes: unpack it first"):
        load(tmp_path / "a.log.gz")


def test_a_file_that_states_its_angles_needs_none(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(CARMEN)
    recording_npz.write(tmp_path / "b", load(tmp_path / "a.log"))
    with pytest.raises(FormatError, match=r"recording.npz states its field of view"):
        load(tmp_path / "b", field_of_view=90.0)


def test_npz_is_recognised(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(CARMEN)
    recording_npz.write(tmp_path / "b", load(tmp_path / "a.log"))
    assert load(tmp_path / "b").name == "a"


def test_relations_come_along(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(CARMEN)
    (tmp_path / "a.relations").write_text(RELATIONS)
    recording = load(tmp_path / "a.log", relations=tmp_path / "a.relations")
    assert recording.relations is not None
    np.testing.assert_array_equal(recording.relations.stamps, [[1, 2], [2, 3]])
    np.testing.assert_array_equal(recording.relations.T_12, [[0.5, 0.25, -1.5], [0, 0, 0.125]])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b" \n\n", "the file is empty"),
        (gzip.compress(b""), "the file is empty"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "a PNG image: a map is read by the yaml beside it"),
        (b"#ROSBAG V2.0\nE\0\0\0", "a ROS 1 bag: "),
        (b"7z\xbc\xaf\x27\x1c\0\4", "compressed with 7-Zip: unpack it"),
        (b"drive.log" + bytes(248) + b"ustar  \0", "a tar archive: unpack it"),
        (gzip.compress(b"drive.log" + bytes(248) + b"ustar  \0"), "a tar archive: unpack it"),
        (b"\7\0\0\1", "not text, and of no kind that is known here"),
        (b"VERTEX_SE2 0 0 0 0\n", "a pose graph"),
        (b"image: a.pgm\n", "the yaml of a ROS map: name it NAME.yaml"),
        (f"FLASER 180 {'0.01 ' * 180}0 0 0 0 0 0 1.0 host 1.0\n".encode(), "no beam of 1 scans returned"),
        (
            bytes(range(1, 256)) * 4,
            "not a recording: expected a ROS bag, a recording.npz, a USARSim log or a CARMEN log",
        ),
        (USARSIM.encode() + b"\0\0", ":4: a zero byte, expected text: was the log cut off"),
        (gzip.compress(CARMEN.encode())[:-20], "torn gzip file"),
        (bz2.compress(CARMEN.encode())[:-20], "torn bzip2 file"),
        (lzma.compress(CARMEN.encode())[:-20], "torn xz file"),
        (ZSTD.compress(CARMEN.encode())[:-20], "torn Zstandard file"),
        (gzip.compress(CARMEN.encode())[:30], "torn gzip file"),
        (b"\x1f\x8b", "torn gzip file"),
        (b"PK\x03\x04 and then nothing", "torn or foreign npz"),
        (b"dear diary\n", "not a recording"),
        (b"# UvA Rescue Team Logfile\n", "no range scans"),
    ],
)
def test_bad_input_is_named_in_one_line(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "bad"
    path.write_bytes(data)
    with pytest.raises(FormatError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}:")
    assert "\n" not in str(caught.value)


def test_missing_file_and_directory(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no such file"):
        load(tmp_path / "nowhere.log")
    with pytest.raises(FormatError, match="is a directory, expected a file"):
        load(tmp_path)


@pytest.mark.parametrize("text", [USARSIM, CARMEN])
def test_cut_anywhere_it_is_refused_or_whole(tmp_path: Path, text: str) -> None:
    """A log of two scans, cut at every byte of its last line: one scan is left only at a line's very end."""
    twice = text + text.removeprefix(HEADER)
    start = twice[:-1].rindex("\n") + 1
    path = tmp_path / "cut.log"
    answers = set()
    for cut in range(start + 1, len(twice) - 1):
        path.write_text(twice[:cut])
        answers.add(scans_or_torn_line(path))
    assert answers <= {"2 scans", f"torn line {twice.count(chr(10))}"}
    assert len(answers) == 2 or text == USARSIM


def scans_or_torn_line(path: Path) -> str:
    try:
        return f"{len(load(path))} scans"
    except FormatError as error:
        return f"torn line {error.line}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("# nothing\n", "no relations, expected lines of t1 t2"),
        ("1 2 3\n", ":1: relation of 3 values, expected 8"),
        (RELATIONS + "1 2 3 4 5 6 7 x\n", ":5: relation: value 8 is 'x'"),
        (RELATIONS + "1 2 3 4 5 6 7 nan\n", ":5: relation: value 8 is 'nan'"),
    ],
)
def test_bad_relations(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.relations").write_text(text)
    with pytest.raises(FormatError, match=message):
        relations.read(tmp_path / "a.relations")


def test_intel_relations(shared_data: Path) -> None:
    found = relations.read(shared_data / "carmen/intel.relations")
    assert found.stamps.shape == (2984, 2)
    np.testing.assert_allclose(found.T_12[0], [-0.05699, -0.12843, -1.68221])


def test_formats_load_without_heavy_imports() -> None:
    code = (
        "import slam.formats, sys; print([m for m in ('numba', 'cv2', 'gtsam', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def flaser(k: int, ranges: np.ndarray, x: float) -> str:
    return f"FLASER 181 {' '.join(f'{r:.2f}' for r in ranges)} {x} 0 0 {x} 0 0 {k}.0 host {k}.0\n"


def test_dead_reckoning_that_never_changes_while_the_scans_do_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    moving = [2.0 + 0.1 * k * np.ones(181) for k in range(8)]
    path.write_text("".join(flaser(k, ranges, 0.0) for k, ranges in enumerate(moving)))
    assert load(path).source == "none"
    path.write_text("".join(flaser(k, ranges, 0.1 * k) for k, ranges in enumerate(moving)))
    assert load(path).source == "odometry"


def test_a_robot_at_rest_has_dead_reckoning(tmp_path: Path) -> None:
    """Somebody walks through a quarter of its view; once it is blinded altogether."""
    path = tmp_path / "a.log"
    ranges = np.full((10, 181), 5.0)
    ranges[3:, 20:65] = 1.0
    ranges[5] = 0.3
    path.write_text("".join(flaser(k, row, 0.0) for k, row in enumerate(ranges)))
    assert load(path).source == "odometry"
