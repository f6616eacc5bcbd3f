"""Settings on the command line: a run is made again from its config.json, and one field is changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from scenarios.methods.config import MethodConfig
from slam.settings import describe

COST = ("wall_s", "scans_per_s", "peak_mb")


def content(folder: Path, name: str) -> Any:
    return json.loads((folder / "drive-seed0" / name).read_text())


def metrics(folder: Path) -> list[dict[str, object]]:
    found = content(folder, "metrics.json")["metrics"]
    return [m for m in found if m["method"] == "slamstitch" and m["metric"] not in COST]


@pytest.fixture(scope="module")
def changed(command: Callable[..., Any], drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with shorter submaps."""
    out = tmp_path_factory.mktemp("changed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scenarios.report.page.run_specs", lambda *_: [])
        finished = command(drive, "--methods", "slamstitch", "--slam.loops.length", 1.5, "--out", out)
    assert finished.code == 0
    return out


def test_a_single_field_changes_config_and_submaps(changed: Path, done: Any) -> None:
    before, after = done.folder.parent, changed
    assert content(before, "config.json")["methods"]["slam"]["loops"].pop("length") == 3.0
    told = content(after, "config.json")
    assert told["methods"]["slam"]["loops"].pop("length") == 1.5
    assert told["options"]["settings"] == {"slam.loops.length": ["1.5"]}
    rest = content(before, "config.json")["methods"]
    rest["slam"]["loops"].pop("length")
    assert told["methods"] == rest
    submaps = [content(folder, "segments.json")["slamstitch"] for folder in (before, after)]
    assert 1 < len(submaps[0]) < len(submaps[1])


@pytest.mark.usefixtures("no_figures")
def test_a_run_s_config_makes_it_again(
    command: Callable[..., Any], changed: Path, drive: Path, tmp_path: Path
) -> None:
    config = changed / "drive-seed0" / "config.json"
    finished = command(drive, "--methods", "slamstitch", "--config", config, "--out", tmp_path)
    assert finished.code == 0
    assert len(metrics(changed)) > 20
    assert metrics(tmp_path) == metrics(changed)
    for name in ("segments.json", "stitches.json"):
        assert content(tmp_path, name) == content(changed, name)
    assert content(tmp_path, "config.json")["methods"] == content(changed, "config.json")["methods"]


def test_what_the_shell_says_counts_more_than_the_file(
    command: Callable[..., Any], changed: Path, tmp_path: Path
) -> None:
    (tmp_path / "part.json").write_text('{"slam": {"loops": {"reach": 2}, "keyframes": {"distance": 0.2}}}')
    finished = command(
        "--list-settings", "--slam.loops.reach", 2.5, "--config", tmp_path / "part.json", "--icp.map_scans=3"
    )
    assert finished.code == 0
    lines = finished.stdout.splitlines()
    for line in ("--slam.loops.reach 2.5", "--slam.keyframes.distance 0.2", "--icp.map_scans 3"):
        assert line in lines
    assert len(lines) == 2 * len(describe(MethodConfig()))


BAD = {
    "--config no.json": "no.json: No such file or directory, expected a JSON file of settings",
    "--config bad.json": "bad.json: unknown key 'slam.lops': did you mean 'loops'?",
    "--slam.loops.lenght 4": "unknown setting --slam.loops.lenght: did you mean 'slam.loops.length'?",
    "--slam.loops.length long": "--slam.loops.length: expected a number, got 'long'",
    "--slam.segmentation.measure trace": "--slam.segmentation.measure: unknown 'trace', did you mean",
    "--icp.method magic": "--icp: unknown matcher 'magic': expected one of wsm, icp, plicp, or",
    "--slam.frontend.method no.such:one": "--slam.frontend: matcher 'no.such:one': No module named 'no'",
    "--htms.align.refinement.method magic": "--htms.align.refinement: unknown matcher 'magic':",
}


@pytest.mark.parametrize("words", BAD)
def test_what_cannot_be_set_is_one_line_and_exit_code_2(
    words: str, command: Callable[..., Any], drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.json").write_text('{"methods": {"slam": {"lops": {}}}}')
    finished = command(drive, *words.split(), "--out", tmp_path / "runs")
    assert (finished.code, finished.stdout) == (2, "")
    (line,) = finished.stderr.splitlines()
    assert line.startswith(f"scenarios.run: {BAD[words]}")
    assert not (tmp_path / "runs").exists()
