"""The same command twice gives the same numbers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
COSTS = {"wall_s", "scans_per_s", "peak_mb"}
ELSEWHERE = """
import sys
from scenarios.report import page
from scenarios.run import COMMAND, Options, main, run
page.run_specs = lambda *_: []
sys.exit(main(Options, COMMAND, run))
"""
"""A run in another process, but for its figures."""


def test_the_same_log_twice_in_two_processes(done, drive, tmp_path):
    command = [sys.executable, "-c", ELSEWHERE, drive, "--format", "json", "--out", tmp_path]
    again = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=True)
    assert without_costs(again.stdout) == without_costs((done.folder / "metrics.json").read_text())
    for name in ("recording.npz", "steps.csv", "segments.json", "stitches.json"):
        assert (tmp_path / "drive-seed0" / name).read_bytes() == (done.folder / name).read_bytes()
    for path in (done.folder / "trajectories").iterdir():
        assert (tmp_path / "drive-seed0" / "trajectories" / path.name).read_bytes() == path.read_bytes()


@pytest.mark.usefixtures("no_figures")
def test_the_same_seed_twice_and_another(command, walk, tmp_path):
    words = (walk, "--methods", "ins", "--format", "json", "--seed")
    first, second, other = (
        command(*words, seed, "--out", tmp_path / out) for seed, out in ((7, "a"), (7, "b"), (8, "c"))
    )
    assert first.code == second.code == other.code == 0
    assert without_costs(first.stdout) == without_costs(second.stdout)
    assert without_costs(first.stdout)["metrics"] != without_costs(other.stdout)["metrics"]


def without_costs(text: str) -> dict:
    content = json.loads(text)
    content["metrics"] = [m for m in content["metrics"] if m["metric"] not in COSTS]
    assert len(content["metrics"]) > 20
    return content
