"""TUM trajectories: every digit survives, and evo agrees on what they mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slam import se2
from slam.formats import FormatError, tum


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tum")


@settings(max_examples=50, deadline=None)
@given(poses=arrays(np.float64, (3, 3), elements=st.floats(-1e4, 1e4)))
def test_round_trip(folder: Path, poses: np.ndarray) -> None:
    time = np.array([976052857.337284, 976052857.337285, 3.0])  # file order, backwards too
    tum.write(folder / "a.tum", time, poses)
    found_time, found = tum.read(folder / "a.tum")
    np.testing.assert_array_equal(found_time, time)
    np.testing.assert_array_equal(found[:, :2], poses[:, :2])
    np.testing.assert_allclose(se2.wrap(found[:, 2] - poses[:, 2]), 0.0, atol=1e-11)


def test_the_line_by_hand(tmp_path: Path) -> None:
    tum.write(tmp_path / "a.tum", [0.1], [[1.0, -2.0, np.pi]])
    words = (tmp_path / "a.tum").read_text().splitlines()[1].split()
    np.testing.assert_allclose(list(map(float, words)), [0.1, 1, -2, 0, 0, 0, 1, 0], atol=1e-15)


def test_evo_reads_the_same_poses(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.normal(0, 50, (20, 2)), rng.uniform(-3, 3, 20)])
    tum.write(tmp_path / "a.tum", np.arange(20) * 0.1, poses)
    trajectory = file_interface.read_tum_trajectory_file(str(tmp_path / "a.tum"))
    np.testing.assert_array_equal(trajectory.positions_xyz[:, :2], poses[:, :2])
    np.testing.assert_allclose(trajectory.get_orientations_euler()[:, 2], poses[:, 2], atol=1e-12)


def test_lengths_must_agree(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected poses of shape \(2, 3\)"):
        tum.write(tmp_path / "a.tum", [1.0, 2.0], np.zeros((3, 3)))
    assert not (tmp_path / "a.tum").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("# nothing\n", "no poses"),
        ("1 2 3\n", ":1: pose of 3 values, expected 8"),
        ("1 2 3 0 0 0 0 1\n1 2 3 0 0 0 x 1\n", ":2: pose: value 7 is 'x'"),
        ("1 2 3 0 0 0 0 0\n", ":1: quaternion is zero"),
    ],
)
def test_bad_input(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(FormatError, match=message):
        tum.read(tmp_path / "a.tum")
