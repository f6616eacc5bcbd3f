"""The built wheel in an empty folder: the library works without the benchmark."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = """
import sys
import numpy as np
from slam.recording import Laser, Recording
from stitch.mapping import Estimate, map_recording

angles = np.radians(np.arange(-135.0, 136.0, 3.0))
poses = np.column_stack([np.linspace(1.0, 4.0, 30), np.full(30, 2.0), np.zeros(30)])
x, y = np.cos(angles), np.sin(angles)
with np.errstate(divide="ignore"):  # a room of 8 x 4 m
    across = np.where(x > 0, 8.0 - poses[:, :1], poses[:, :1]) / np.abs(x)
    along = np.where(y > 0, 4.0 - poses[:, 1:2], poses[:, 1:2]) / np.abs(y)
ranges = np.minimum(across, along)
estimate = map_recording(Recording("room", 0.2 * np.arange(30), ranges, angles, Laser(), poses))
assert isinstance(estimate, Estimate)
assert np.abs(estimate.poses - poses).max() < 0.02, estimate.poses - poses
assert estimate.submaps
here = {name.split(".")[0] for name in sys.modules}
assert not here & {"scenarios", "sim", "pymunk", "matplotlib", "dask", "jinja2"}, here
import slam, stitch
print(slam.__path__[0])
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what is in the wheel, as pip unpacks it."""
    built = tmp_path_factory.mktemp("wheel")
    words = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--no-deps",
        "--no-build-isolation",
        "-q",
        "-w",
        str(built),
    ]
    done = subprocess.run([*words, str(ROOT)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = built.glob("slamstitch-*.whl")
    zipfile.ZipFile(wheel).extractall(built / "site")
    take_compiled_kernels(built / "site")
    return built / "site"


def take_compiled_kernels(site: Path) -> None:
    """Give the unpacked files the checkout's times and numba's caches, so that nothing is compiled twice."""
    for path in [*site.glob("slam/**/*.py"), *site.glob("stitch/**/*.py")]:
        source = ROOT / path.relative_to(site)
        if source.read_bytes() != path.read_bytes():
            raise AssertionError(f"{source} is not what is in the wheel")
        shutil.copystat(source, path)
        for cache in (source.parent / "__pycache__").glob(f"{source.stem}.*.nb?"):
            (path.parent / "__pycache__").mkdir(exist_ok=True)
            shutil.copy2(cache, path.parent / "__pycache__")


def test_the_wheel_holds_four_packages_and_what_they_need(installed: Path) -> None:
    packages = {path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")}
    assert packages == {"scenarios", "sim", "slam", "stitch"}
    assert (installed / "stitch" / "alignment" / "acceptance.npz").is_file()


def test_a_recording_is_mapped_without_the_benchmark(installed: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1"}
    words = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(installed / "slam")
