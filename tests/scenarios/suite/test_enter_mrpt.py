"""The script of the documentation that enters MRPT's icp-slam: what it does to logs and paths."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from slam.formats import carmen, tum
from slam.recording import Laser, Recording

DOCS = Path(__file__).resolve().parents[3] / "docs"
needs_awk = pytest.mark.skipif(shutil.which("awk") is None, reason="no awk on the PATH")


def drive() -> Recording:
    time = np.array([0.25, 0.5, 1.0])
    poses = np.array([[0.0, 0, 0], [0.1, 0, 0.1], [0.2, 0.05, 0.2]])
    return Recording("a", time, np.full((3, 5), 2.0), np.linspace(-1, 1, 5), Laser(), poses)


@needs_awk
def test_a_row_of_the_path_goes_to_its_scan(tmp_path: Path) -> None:
    recording = drive()
    carmen.write(tmp_path / "a.log", recording)
    path = [f"{k} {x} {y} {yaw}" for k, (x, y, yaw) in enumerate(np.repeat(recording.dead_reckoning, 2, 0))]
    (tmp_path / "path.txt").write_text("\n".join(path) + "\n")
    command = ["awk", "-f", str(DOCS / "enter_mrpt.awk")]
    made = subprocess.run([*command, "path.txt", "a.log"], cwd=tmp_path, capture_output=True, check=True)
    (tmp_path / "a.tum").write_bytes(made.stdout)
    time, poses = tum.read(tmp_path / "a.tum")
    np.testing.assert_array_equal(time, recording.time)
    np.testing.assert_allclose(poses, recording.dead_reckoning, atol=1e-8)
    scaled = subprocess.run([*command, "a.log"], cwd=tmp_path, capture_output=True, check=True, text=True)
    (tmp_path / "scaled.log").write_text(scaled.stdout)
    np.testing.assert_allclose(carmen.read(tmp_path / "scaled.log").time, 1e12 * recording.time)


@needs_awk
@pytest.mark.skipif(shutil.which("icp-slam") is None, reason="MRPT is not installed: apt install mrpt-apps")
def test_icp_slam_answers_a_suite(tmp_path: Path) -> None:
    (tmp_path / "v1" / "hospital-0").mkdir(parents=True)
    carmen.write(tmp_path / "v1" / "hospital-0" / "hospital-0.log", drive())
    subprocess.run(["sh", str(DOCS / "enter_mrpt.sh"), "v1"], cwd=tmp_path, check=True, capture_output=True)
    with zipfile.ZipFile(tmp_path / "answers.zip") as archive:
        assert "answers/hospital-0.tum" in archive.namelist()
    assert len(tum.read(tmp_path / "answers" / "hospital-0.tum")[0]) == 3
