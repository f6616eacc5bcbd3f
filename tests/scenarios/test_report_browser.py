"""The page of a run as a person meets it, in a browser."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.evaluation import evaluate
from scenarios.report import compare
from scenarios.report.figures import run_specs
from scenarios.report.page import render
from sim.floorplan import box, wall
from sim.record import Setup, SimulatedRun, simulate
from sim.smoke import Smoke
from sim.terrain import Terrain
from sim.world import World
from slam import se2
from slam.mapping.submap import cut
from slam.odometry.tracker import MANIFOLD_SLAM, track
from slam.recording import Recording
from slam.scan import scans_of
from stitch.alignment.result import Alternative, NoStitch, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no browser: expected chromium on the PATH")

SETTLED = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
DRAWN = "() => [...document.querySelectorAll('#map canvas')].map((canvas) => canvas.toDataURL()).join()"
ATTACK = "</script><script>window.hacked = 1</script>"


class Room:
    """A room with a ramp, a pillar and smoke."""

    name = "room"

    def build(self, rng: np.random.Generator) -> Setup:
        corners = np.array([[0.0, 0.0], [7.0, 0.0], [7.0, 3.0], [0.0, 3.0], [0.0, 0.0]])
        walls = [p for a, b in pairwise(corners) for p in wall(a, b)]
        ground = Terrain.level([-1.0, -1.0], [8.0, 4.0]).with_ramp([2.5, 1.5], [3.5, 1.5], 1.5, 0.1)
        smoke = Smoke.clear([0.0, 0.0], [7.0, 3.0]).with_disc([6.0, 1.0], 1.0, 1.0)
        world = World((*walls, box([5.5, 2.5, 0.0], 0.4, 0.4)), ground, 2.5, smoke)
        return Setup(world, (1.0, 1.5, 0.0), np.array([[1.5, 1.5], [6.0, 1.5]]))


@dataclass(frozen=True)
class Made:
    simulated: SimulatedRun
    estimates: list[Estimate]

    @property
    def recording(self) -> Recording:
        return self.simulated.recording

    def page(self, simulated: SimulatedRun | None = None) -> str:
        metrics = evaluate(self.recording, self.estimates)
        figures = run_specs(self.recording, self.estimates, metrics)[:1]
        run = {"command": "python -m scenarios.run room", "seed": 0}
        return render(self.recording, self.estimates, metrics, run, figures, simulated)


@pytest.fixture(scope="module")
def made() -> Made:
    simulated = simulate(Room(), 0)
    recording = simulated.recording
    wsm = track(recording, MANIFOLD_SLAM)
    ins = Estimate("ins", recording.dead_reckoning)
    return Made(simulated, [ins, Estimate("wsm", wsm.poses, track=wsm), stitched(recording)])


def stitched(recording: Recording) -> Estimate:
    """Our front end's track as two submaps with a gap between, and a stitch of every kind from one to the
    other."""
    found, scans, n = track(recording), scans_of(recording), len(recording)
    a, b = (
        cut(recording, scans, found.poses, start, stop, np.arange(n))
        for start, stop in ((0, n // 2), (n // 2 + 2, n))
    )
    T = se2.between(recording.truth[a.start], recording.truth[b.start])
    true = Stitch(T, 1e-4 * np.eye(3), 3.0, 5.0, 0.9, (Alternative(T + 0.5, 1.0),))
    results = [
        (true, 1.0),
        (replace(true, T_a_b=T + 0.6), 1.0),
        (true, 0.0),
        (NoStitch("ambiguity 0.9", Alternative(T, 1.0)), None),
        (NoStitch("no candidate"), None),
    ]
    tried = tuple(LoopCandidate(0, 1, result, weight) for result, weight in results)
    sure = np.tile(1e-3 * np.eye(3), (n, 1, 1))
    return Estimate("slamstitch", found.poses, sure, found, (a, b), tried)


@pytest.fixture(scope="module")
def page(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(made.page(made.simulated), tmp_path_factory.mktemp("page"))


def written(text: str, folder: Path) -> Path:
    (folder / "report.html").write_text(text, encoding="utf-8")
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@dataclass
class Tab:
    """A page open in the browser; what it complained of and what it asked the network for."""

    page: Any
    trouble: list[str] = field(default_factory=list)

    def settled(self) -> Tab:
        self.page.evaluate(SETTLED)
        return self

    def drawn(self) -> str:
        return self.settled().page.evaluate(DRAWN)


@contextmanager
def opened(browser: Any, path: Path, width: int = 1280, **options: Any) -> Iterator[Tab]:
    context = browser.new_context(viewport={"width": width, "height": 800}, **options)
    tab = Tab(context.new_page())
    tab.page.on("console", lambda message: tab.trouble.append(message.text))
    tab.page.on("pageerror", lambda error: tab.trouble.append(str(error)))
    tab.page.on("request", lambda asked: tab.trouble.append(asked.url) if outside(asked.url) else None)
    tab.page.goto(path.as_uri())
    tab.page.wait_for_selector("html[data-ready=true]", timeout=10_000)
    yield tab
    assert tab.trouble == []
    context.close()


def outside(address: str) -> bool:
    return not address.startswith(("file:", "data:", "blob:"))


def test_every_layer_can_be_switched(browser: Any, page: Path) -> None:
    with opened(browser, page) as tab:
        boxes = tab.page.locator("input[data-layer]")
        names = boxes.evaluate_all("(found) => found.map((box) => box.dataset.layer)")
        assert {"walls", "truth", "terrain", "smoke", "map-0", "path-0", "submaps", "scan", "ellipse"} <= set(
            names
        )
        assert {f"stitches-{state}" for state in ("accepted", "false", "rejected", "refused")} <= set(names)
        unchanged = []
        for name in names:
            box, before = tab.page.locator(f"input[data-layer={name}]"), tab.drawn()
            box.click()
            if not any(tab.drawn() != before for _ in range(20)):  # images are decoded on the side
                unchanged.append(name)
            box.click()
        assert unchanged == []


def test_the_slider_moves_the_robot(browser: Any, page: Path) -> None:
    with opened(browser, page) as tab:
        facts, scan = tab.page.locator("#robot-facts"), tab.page.locator("#scan")
        scan.focus()
        tab.page.keyboard.press("Home")
        told, drawn, tilt = facts.inner_text(), tab.drawn(), tab.page.locator("#tilt").inner_html()
        assert "scan 0 of" in tab.page.locator("#scan-text").inner_text()
        for _ in range(30):
            tab.page.keyboard.press("ArrowRight")
        assert "scan 30 of" in scan.get_attribute("aria-valuetext")
        assert facts.inner_text() != told
        assert tab.drawn() != drawn
        assert tab.page.locator("#tilt").inner_html() != tilt
        tab.page.locator("#play").click()
        tab.page.wait_for_function("() => Number(document.getElementById('scan').value) > 30")
        tab.page.locator("#play").click()


def test_a_stitch_opens_from_the_list_and_from_the_map(browser: Any, page: Path) -> None:
    with opened(browser, page) as tab:
        opened_stitch = tab.page.locator("#stitch")
        assert not opened_stitch.is_visible()
        verdicts = ["accepted", "accepted, but false", "rejected by the graph", "refused", "refused"]
        for index, verdict in enumerate(verdicts):
            tab.page.locator("#stitch-list button").nth(index).focus()
            tab.page.keyboard.press("Enter")
            assert verdict in opened_stitch.locator("dl").inner_text()
            assert opened_stitch.locator(".panels > div").count() == (9 if index < 4 else 1)
        assert "no candidate" in opened_stitch.inner_text()
        opened_stitch.get_by_role("button", name="Close").click()
        assert not opened_stitch.is_visible()
        tab.page.locator("#map").scroll_into_view_if_needed()
        tab.page.mouse.click(*tab.settled().page.evaluate(SPOT))
        assert opened_stitch.is_visible()


SPOT = """() => {
  const canvas = document.querySelector('.leaflet-stitches-pane canvas');
  const box = canvas.getBoundingClientRect();
  const { data, width } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const inked = [...Array(data.length / 4).keys()].filter((i) => data[4 * i + 3] > 200);
  const i = inked[inked.length >> 1], scale = box.width / canvas.width;
  return [box.left + scale * (i % width), box.top + scale * Math.floor(i / width)];
}"""


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_and_has_its_colours(browser: Any, page: Path, width: int, scheme: str) -> None:
    with opened(browser, page, width, color_scheme=scheme) as tab:
        assert tab.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert tab.page.locator("#map").bounding_box()["width"] > 0.7 * min(width, 900)
        assert brightness(tab) > 0.9 if scheme == "light" else brightness(tab) < 0.2
        before = tab.drawn()
        tab.page.locator("#theme").click()
        assert brightness(tab) < 0.2 if scheme == "light" else brightness(tab) > 0.9
        assert tab.drawn() != before


def brightness(tab: Tab) -> float:
    colour = tab.page.evaluate("getComputedStyle(document.body).backgroundColor")
    return sum(map(int, colour.strip("rgb()").split(","))) / (3 * 255)


def test_everything_is_named_and_reached_by_keyboard(browser: Any, page: Path) -> None:
    with opened(browser, page) as tab:
        nameless = tab.page.evaluate(NAMELESS)
        assert nameless == []
        reached = []
        for _ in range(60):
            tab.page.keyboard.press("Tab")
            reached.append(
                tab.page.evaluate("document.activeElement.id || document.activeElement.dataset.layer")
            )
        assert {"theme", "copy", "map", "play", "scan", "method", "walls", "path-0", "whole"} <= set(reached)
        assert reached.index("map") < reached.index("scan")


FOCUSED = "() => document.activeElement.id || document.activeElement.dataset.layer"
NAMELESS = """() => [...document.querySelectorAll('button, input, select, a, img, [role=img], [role=region]')]
  .filter((e) => !e.getAttribute('aria-label') && !e.alt && !e.textContent.trim() && !e.labels?.length)
  .map((e) => e.outerHTML)"""


def test_names_from_outside_stay_text(browser: Any, made: Made, tmp_path: Path) -> None:
    named = replace(made.recording, name=ATTACK)
    estimate = replace(made.estimates[2], method=ATTACK)
    hostile = Made(replace(made.simulated, recording=named), [made.estimates[0], estimate])
    with opened(browser, written(hostile.page(), tmp_path)) as tab:
        tab.page.locator("#stitch-list button").first.click()
        assert tab.page.locator("h1").inner_text() == ATTACK
        assert ATTACK in tab.page.locator("#stitch h3").inner_text()
        assert tab.page.evaluate("window.hacked") is None


def test_what_is_not_known_is_left_out(browser: Any, made: Made, tmp_path: Path) -> None:
    recording = replace(made.recording, truth=None, attitude=None)
    lost = Estimate(
        "lost", np.column_stack([1e6 * np.arange(len(recording)), *np.zeros((2, len(recording)))])
    )
    bare = Made(replace(made.simulated, recording=recording), [lost, *made.estimates])
    with opened(browser, written(bare.page(), tmp_path)) as tab:
        assert "no attitude" in tab.page.locator("#tilt").text_content()
        assert "not recorded" in tab.page.locator("#robot-facts").inner_text()
        assert "position error" not in tab.page.locator("#robot-facts").inner_text()
        assert tab.page.locator("input[data-layer=walls]").count() == 0
        assert tab.page.locator("input[data-layer=map-0]").count() == 0
        tab.page.locator("#method").select_option("0")
        assert tab.page.locator("#no-stitches").is_visible()


def test_a_comparison_links_its_worst_drives(browser: Any, page: Path, tmp_path: Path) -> None:
    for seed, error in enumerate((0.1, 0.3, 0.2)):
        folder = tmp_path / f"room-seed{seed}"
        folder.mkdir()
        metric = {"method": ATTACK, "metric": "ate_rmse", "value": error, "unit": "m", "better": "lower"}
        told = {
            "recording": "room",
            "seed": seed,
            "metrics": [metric, {**metric, "method": "b", "value": 1.0}],
        }
        (folder / "metrics.json").write_text(json.dumps(told))
        shutil.copy(page, folder / "report.html")
    compare.run(sorted(tmp_path.iterdir()), tmp_path / "compare.html", "table")
    tab = Tab(browser.new_context().new_page())
    tab.page.on("pageerror", lambda error: tab.trouble.append(str(error)))
    tab.page.goto((tmp_path / "compare.html").as_uri())
    assert tab.page.evaluate("window.hacked") is None
    assert tab.page.locator("circle").count() == 6
    tab.page.locator("td a").first.click()
    tab.page.wait_for_selector("html[data-ready=true]")
    assert tab.page.url == (tmp_path / "room-seed1" / "report.html").as_uri()
    assert tab.trouble == []
    tab.page.context.close()
