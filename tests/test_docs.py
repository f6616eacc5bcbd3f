"""What the documentation says can be run is run, and what it points at is there."""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
import runpy
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.run import COMMAND, Options, run
from slam.cli import main
from slam.formats import carmen, load, ros_map
from slam.mapping.occupancy import Grid
from slam.matching import MATCHERS
from slam.odometry.combination import BIAS, WEIGHTS
from slam.odometry.confidence import MEASURES
from slam.odometry.tracker import FrontendConfig
from slam.recording import Laser, Recording
from stitch.align import Stitch
from stitch.alignment import likelihood
from stitch.alignment.acceptance import AcceptanceClassifier
from stitch.alignment.config import AlignConfig
from stitch.mapping import MappingConfig

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
PACKAGES = "docs|scenarios|sim|slam|stitch|tests"


def section(title: str) -> str:
    """The README's section of that title."""
    return (ROOT / "README.md").read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]


BLOCKS = {
    name: "\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S))
    for name, text in re.findall(
        r"^A \*\*(\w+)\*\*(.*?)(?=^A (?:whole )?\*\*|\Z)", section("Bring your own"), re.M | re.S
    )
}
"""What one brings -> the code that takes it."""

PROOF: dict[str, Callable[[dict[str, Any]], bool]] = {
    "log": lambda known: known["estimate"].poses.shape == (50, 3),
    "map": lambda known: load("my_map.npz").truth is not None,
    "matcher": lambda known: (
        known["score"].pairs == 20 and known["score"].success > 0.5 and known["drive"].matched_share > 0.9
    ),
    "measure": lambda known: "unpaired" in known["found"].confidence,
}
"""What holds when an example has done what it says, by the names that it left behind."""


def flat() -> Grid:
    """Two rooms of 3 × 3 m with a door of 1 m, unknown outside."""
    occupied = np.zeros((66, 128), dtype=bool)
    occupied[[2, 63], 2:125] = True
    occupied[2:64, [2, 63, 124]] = True
    occupied[22:44, 63] = False
    inside = np.zeros_like(occupied)
    inside[3:63, 3:124] = True
    return Grid(occupied, inside & ~occupied, np.zeros(2), 0.05)


def walk() -> Recording:
    """Fifty scans along a room of 8 × 4 m, with an exact odometry."""
    from sim.laser import Raycaster

    room = [[0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0], [3, 0, 3, 1], [5, 3, 6, 3]]
    angles = np.radians(np.arange(-90.0, 91.0, 2.0))
    poses = np.stack([np.linspace(1.0, 6.0, 50), np.full(50, 2.0), 0.3 * np.sin(np.arange(50) / 8.0)], -1)
    ranges = Raycaster.from_segments(room).cast(poses, angles)
    laser = Laser(range_max=20.0)
    return Recording("walk", 0.3 * np.arange(50), ranges, angles, laser, poses, truth=poses)


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to be in, with a log and a map in it; what an example registers is forgotten afterwards."""
    carmen.write(tmp_path / "my_drive.log", walk())
    ros_map.write(tmp_path / "my_map.yaml", flat())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = [(known, dict(known)) for known in (MEASURES, MATCHERS)]
    yield tmp_path
    for known, entries in before:
        known.clear()
        known.update(entries)


def test_every_block_of_the_section_is_run_here() -> None:
    assert list(BLOCKS) == ["log", "map", "matcher", "measure"]
    assert section("Bring your own").count("```") == 2 * len(BLOCKS) + 2  # a matcher has two


def test_the_library_s_examples_run(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    offline, online = re.findall(r"^```python\n(.*?)^```$", section("From Python"), re.M | re.S)
    known: dict[str, Any] = {}
    exec(compile(offline, "README.md, a whole recording", "exec"), known)
    assert known["estimate"].poses.shape == (50, 3)
    exec(compile(online, "README.md, scan by scan", "exec"), known)
    assert capsys.readouterr().out.count("MATCHED") >= 45
    assert known["estimate"].poses.shape == (50, 3)
    assert np.abs(known["estimate"].poses - known["drive"].dead_reckoning).max() < 0.02


def test_the_way_of_one_scan_is_told_in_25_files() -> None:
    text = (ROOT / "docs" / "README.md").read_text().split("## The way of one scan")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (\d+) \| `([\w/.]+)` \|", text, re.M)
    assert [int(number) for number, _ in rows] == list(range(1, len(rows) + 1))
    assert len(rows) <= 25
    assert all((ROOT / path).is_file() for _, path in rows)


@pytest.mark.parametrize("name", BLOCKS)
def test_what_you_bring_runs(name: str, elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known: dict[str, Any] = {}
    exec(compile(BLOCKS[name], f"README.md, your own {name}", "exec"), known)
    assert PROOF[name](known)
    assert capsys.readouterr().out.strip()


def test_a_matcher_of_a_module_is_taken_from_the_shell(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (elsewhere / "my_matcher.py").write_text(BLOCKS["matcher"].split("from scenarios.bench")[0])
    monkeypatch.syspath_prepend(str(elsewhere))
    command = "run my_drive.log --matcher my_matcher:nearest --methods slamstitch --format json"
    monkeypatch.setattr(sys, "argv", command.split())
    assert main(Options, COMMAND, run) == 0
    config = json.loads((elsewhere / "runs" / "latest" / "config.json").read_text())
    assert config["methods"]["slam"]["frontend"]["method"] == "my_matcher:nearest"
    assert json.loads(capsys.readouterr().out)["scans"] == 50


def test_the_tutorial_runs(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = runpy.run_path(str(ROOT / "docs" / "tutorial.py"))
    assert told["picture"].is_relative_to(elsewhere)
    assert told["picture"].stat().st_size > 10_000
    assert isinstance(told["stitch"], Stitch)
    assert np.hypot(*told["off"][:2]) < 0.05
    assert told["scores"]["slamstitch", "ate_rmse"] < told["scores"]["ins", "ate_rmse"]
    assert "stitched" in capsys.readouterr().out


def test_there_is_a_page_for_every_stage_and_the_index_has_them_all() -> None:
    listed = set(re.findall(r"\]\((\w+\.(?:md|py))\)", (ROOT / "docs" / "README.md").read_text()))
    assert listed == {page.name for page in PAGES if page.name != "README.md"} | {"tutorial.py"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_points_at_is_there(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S)
    links = [link.split("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link]
    paths = re.findall(rf"(?<![\w/.])((?:{PACKAGES})/[\w/.]*\w/?)", text)
    assert links or paths
    missing = [link for link in links if link and not (page.parent / link).exists()]
    missing += [path for path in paths if not (ROOT / path).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_module_that_a_page_runs_is_there(page: Path) -> None:
    for module in re.findall(r"python -m ((?:scenarios|stitch|slam|sim)[\w.]*)", page.read_text()):
        assert importlib.util.find_spec(module), f"python -m {module}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_in_code_are_names_of_the_code(page: Path) -> None:
    """`package.module.name` in a page is something that can be imported."""
    for dotted in set(re.findall(r"`((?:slam|stitch|sim|scenarios)(?:\.\w+)+)`", page.read_text())):
        assert importable(dotted), dotted


def importable(dotted: str) -> bool:
    """Whether a dotted name is a module, or a name in one."""
    module, _, name = dotted.rpartition(".")
    try:
        importlib.import_module(dotted)
    except ModuleNotFoundError:
        return bool(module) and hasattr(importlib.import_module(module), name)
    return True


def stated() -> Iterator[tuple[str, str]]:
    """Page and what it must say, made of the constants of the code."""
    align, mapping = AlignConfig(), MappingConfig()
    bundle, loops = mapping.bundle, mapping.loops
    accept = align.acceptance
    yield "front_end.md", f"last {FrontendConfig().map_scans} keyframes"
    yield "front_end.md", f"χ² = {FrontendConfig().max_innovation:.0f} from the guess"
    yield "segmentation.md", f"{BIAS:.2f} + {WEIGHTS['innovation']:.2f} ln innovation".replace("-", "−")
    yield "segmentation.md", f"fewer than {mapping.segmentation.least_steps} matched steps"
    yield "stitching.md", f"λ = {align.search.free_penalty:.0f} (maps that agree)"
    yield "stitching.md", f"λ = {align.search.lenient_penalty:.0f} (bent maps, moved furniture)"
    yield "stitching.md", f"{likelihood.BIAS:.2f} (+ {likelihood.PRIOR_BONUS:.2f}".replace("-", "− ")
    yield "stitching.md", f"{len(AcceptanceClassifier.learnt().mean)} numbers"
    yield "stitching.md", f"{len(AcceptanceClassifier.learnt().offset)} tanh units"
    yield "stitching.md", f"overlap ≥ {accept.min_overlap:g} m², ≥ {accept.min_open:g} m² free in both"
    yield "stitching.md", f"log-odds ≥ {accept.min_lead:g} ahead of any rival"
    yield "stitching.md", f"χ²₃({align.prior.confidence}) of the prior"
    yield "pose_graph.md", f"at most {loops.candidates} earlier ones"
    yield "pose_graph.md", f"w = {loops.window_ins} m with an INS, {loops.window} m without"
    yield "pose_graph.md", f"distances {', '.join(map(str, bundle.radii))} m"
    yield "pose_graph.md", f"up to {bundle.neighbours} earlier ones within {bundle.reach:g} m"
    yield (
        "online.md",
        f"at most {mapping.online.neighbours} earlier ones ({mapping.online.per_pass} of one pass)",
    )


def test_the_pages_say_what_the_code_does() -> None:
    pages = {page.name: " ".join(page.read_text().split()) for page in PAGES}
    assert [(page, said) for page, said in stated() if said not in pages[page]] == []
