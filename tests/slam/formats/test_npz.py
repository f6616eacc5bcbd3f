"""recording.npz: everything comes back, and the same recording is the same bytes."""

from __future__ import annotations

import dataclasses
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from slam.formats import FormatError, load, recording_npz
from slam.recording import Laser, Odometry, Recording, Relations


def full_recording() -> Recording:
    rng = np.random.default_rng(1)
    ranges = rng.uniform(0.5, 9.0, (4, 7))
    ranges[1, 3] = np.nan
    return Recording(
        name="hospital α",
        time=np.array([1.0, 2.0, 1.5, 3.0]),
        ranges=ranges,
        angles=np.linspace(-1.0, 1.0, 7),
        laser=Laser(0.2, 9.5, 0.03, np.array([-0.08, 0.01, 0.1])),
        dead_reckoning=rng.normal(size=(4, 3)),
        source="ins",
        odometry=Odometry(np.arange(9.0), rng.normal(size=(9, 3)), np.array([0, 2, 4, 8])),
        attitude=rng.normal(size=(4, 2)),
        truth=rng.normal(size=(4, 3)),
        relations=Relations(np.array([[1.0, 2.0]]), np.array([[0.1, 0.2, 0.3]])),
    )


def bare_recording() -> Recording:
    return dataclasses.replace(
        full_recording(), source="odometry", odometry=None, attitude=None, truth=None, relations=None
    )


def assert_same(a: object, b: object) -> None:
    """Field by field, exactly."""
    for entry in dataclasses.fields(a):  # type: ignore[arg-type]
        left, right = getattr(a, entry.name), getattr(b, entry.name)
        if dataclasses.is_dataclass(left):
            assert_same(left, right)
        elif isinstance(left, np.ndarray):
            assert left.dtype == right.dtype, entry.name
            np.testing.assert_array_equal(left, right, err_msg=entry.name)
        else:
            assert left == right, entry.name


@pytest.mark.parametrize("recording", [full_recording(), bare_recording()], ids=["full", "bare"])
def test_everything_comes_back(tmp_path: Path, recording: Recording) -> None:
    recording_npz.write(tmp_path / "recording.npz", recording)
    assert_same(recording, recording_npz.read(tmp_path / "recording.npz"))
    assert_same(recording, load(tmp_path / "recording.npz"))


def test_the_same_recording_is_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording_npz.write(tmp_path / "a.npz", full_recording())
    monkeypatch.setattr(time, "time", lambda: 2e9)
    monkeypatch.setattr(time, "localtime", lambda *_: time.gmtime(2e9))
    recording_npz.write(tmp_path / "b.npz", full_recording())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_plain_numpy_reads_it(tmp_path: Path) -> None:
    recording_npz.write(tmp_path / "a.npz", full_recording())
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert str(archive["name"]) == "hospital α"
        assert archive["ranges"].shape == (4, 7)
        assert "T_robot_laser" in archive.files


def test_torn_and_foreign_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    recording_npz.write(path, full_recording())
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    with pytest.raises(FormatError, match=r"a\.npz: torn or foreign npz"):
        load(path)
    np.savez(path, ranges=np.ones((2, 3)))
    with pytest.raises(FormatError, match=r"a\.npz: no array 'schema', expected a recording\.npz"):
        load(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(FormatError, match="no array"):
        load(path)


def test_a_damaged_array_never_passes_unnoticed(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    recording_npz.write(path, full_recording())
    whole = path.read_bytes()
    refused = 0
    for position in range(4, whole.index(b"PK\x01\x02"), 7):  # up to the zip's directory
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 0xFF]) + whole[position + 1 :])
        try:
            assert_same(full_recording(), load(path))  # a date, say
        except FormatError:
            refused += 1
    assert refused > 100


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time", np.ones(3)),
        ("truth", np.full((4, 3), np.nan)),
        ("ranges", np.array([["a"]])),
        ("source", np.array("gps")),
        ("laser_limits", np.ones(2)),
        ("schema", np.array(2)),
        ("schema", np.array([1])),
        ("odometry_poses", None),
        ("name", np.array([{}], dtype=object)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, name: str, value: np.ndarray | None) -> None:
    recording_npz.write(tmp_path / "a.npz", full_recording())
    with np.load(tmp_path / "a.npz") as archive:
        arrays = {key: archive[key] for key in archive.files if key != name}
    if value is not None:
        arrays[name] = value
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(FormatError) as caught:
        load(tmp_path / "a.npz")
    assert "\n" not in str(caught.value)
