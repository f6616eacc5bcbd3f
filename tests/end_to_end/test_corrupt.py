"""--corrupt: the run folder and the page say what was done, and the clean run stays."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.corruptions import LONGEST, name_part, parse_corruptions
from scenarios.report.compare import collect_results
from sim.corruption import CORRUPTIONS
from slam.formats import load

NAME = "drive-odometry.late-1-laser.dropped-0.5-seed0"


def numbers(folder: Path) -> dict[str, object]:
    metrics = json.loads((folder / "metrics.json").read_text())["metrics"]
    return {
        m["metric"]: m["value"] for m in metrics if m["metric"] not in ("wall_s", "scans_per_s", "peak_mb")
    }


@pytest.fixture(scope="module")
def runs(command: Callable[..., Any], drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean run, and one that was spoilt in two ways."""
    out = tmp_path_factory.mktemp("spoilt")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scenarios.report.page.run_specs", lambda *_: [])
        spoilt = ("--corrupt", "odometry.late", "--corrupt", "laser.dropped=0.5")
        for words in ((), spoilt):
            assert command(drive, "--methods", "ins", "--out", out, *words).code == 0
    return out


def test_the_clean_run_stays(runs: Path) -> None:
    assert sorted(path.name for path in runs.iterdir()) == [NAME, "drive-seed0", "latest"]
    assert numbers(runs / NAME) != numbers(runs / "drive-seed0")


def test_the_folder_says_what_was_done(runs: Path) -> None:
    done = ["odometry.late=1", "laser.dropped=0.5"]
    for file in ("config.json", "metrics.json"):
        assert json.loads((runs / NAME / file).read_text())["corruptions"] == done
        assert json.loads((runs / "drive-seed0" / file).read_text())["corruptions"] == []
    page = (runs / NAME / "report.html").read_text()
    assert "Spoilt on purpose: odometry.late=1 (a scan gets the pose of an earlier one" in page
    assert "Spoilt on purpose" not in (runs / "drive-seed0" / "report.html").read_text()


def test_runs_are_compared_by_what_was_done(runs: Path) -> None:
    found = {result.scenario for result in collect_results([runs / NAME, runs / "drive-seed0"])}
    assert len(found) == 2
    assert any(name.endswith(" + odometry.late=1 + laser.dropped=0.5") for name in found)


def test_the_recording_is_spoilt_and_its_truth_is_not(runs: Path, drive: Path) -> None:
    clean, spoilt = load(drive), load(runs / NAME / "recording.npz")
    np.testing.assert_array_equal(spoilt.truth, clean.truth)
    np.testing.assert_array_equal(spoilt.dead_reckoning[1:], clean.dead_reckoning[:-1])
    lost = np.isnan(spoilt.ranges) & np.isfinite(clean.ranges)
    assert lost.sum() / np.isfinite(clean.ranges).sum() == pytest.approx(0.5, abs=0.03)


@pytest.mark.usefixtures("no_figures")
def test_the_seed_draws_what_is_spoilt(command: Callable[..., Any], drive: Path, tmp_path: Path) -> None:
    spoilt = (drive, "--methods", "ins", "--corrupt", "laser.dropped=0.5", "--out")
    for seed, out in ((0, "first"), (0, "again"), (1, "other")):
        assert command(*spoilt, tmp_path / out, "--seed", seed).code == 0
    first, again, other = (
        load(next((tmp_path / out).glob("drive-*")) / "recording.npz").ranges
        for out in ("first", "again", "other")
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other, equal_nan=True)


@pytest.mark.usefixtures("no_figures")
def test_a_simulated_drive_is_spoilt_too(command: Callable[..., Any], walk: str, tmp_path: Path) -> None:
    finished = command(walk, "--methods", "ins", "--corrupt", "odometry.jumps", "--out", tmp_path)
    assert finished.code == 0
    assert "spoilt on purpose: odometry.jumps=5 (the position jumps by 1 m" in finished.stderr
    assert load(tmp_path / "walk-odometry.jumps-5-seed0" / "recording.npz").corruptions == (
        "odometry.jumps=5",
    )


def test_the_list_has_every_kind(command: Callable[..., Any]) -> None:
    finished = command("--list-corruptions")
    assert finished.code == 0
    lines = finished.stdout.splitlines()
    for kind in CORRUPTIONS.values():
        (line,) = [line for line in lines if line.split()[:1] == [kind.name]]
        assert kind.does in line
        assert kind.severity is None or f" {kind.severity.default:g} " in line


def test_names_of_many_corruptions_stay_short_and_apart() -> None:
    many, more = (name_part(parse_corruptions([f"laser.noise=0.0{k}"] * 20)) for k in (1, 2))
    assert many != more
    assert len(many) <= LONGEST + 9
