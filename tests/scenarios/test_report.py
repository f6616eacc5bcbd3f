import html.parser
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from scenarios.evaluation import cost, evaluate, missing, to_metrics
from scenarios.evaluation.metric import Metric
from scenarios.report.figures import figure_titles, run_specs
from scenarios.report.page import render
from scenarios.report.style import panels, png
from scenarios.report.summary import headline, scores, tabulate, verdict
from scenarios.report.trajectory_figures import draw_confidence, draw_maps, draw_trajectories
from scenarios.stages import Cost
from slam.colours import BLACK, BLUE, ORANGE, VERMILLION
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.odometry.track import Track
from slam.recording import Laser, Recording
from slam.scan import Scan
from stitch.mapping.estimate import Estimate

N = 40


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A drive of 4 m along a wall that winds about it."""
    angles = np.linspace(-1.5, 1.5, 61)
    truth = np.column_stack([0.1 * np.arange(N), np.zeros(N), np.zeros(N)])
    ranges = np.tile(2.0 + np.cos(3 * angles), (N, 1))
    return Recording("drive", np.arange(N), ranges, angles, Laser(), truth * [1.0, 1, 1], truth=truth)


def track(matches: np.ndarray) -> Track:
    with np.errstate(divide="ignore"):
        trace = np.where(matches > 0, 1.0 / matches, np.inf)
    trace[1::4] = np.nan  # not tried
    confidence = {"trace2": trace, "det2": trace**2 / 4, "neg_matches": -matches.astype(float)}
    nothing = np.full((N, 3, 3), np.nan)
    return Track(
        np.zeros((N, 3)), np.zeros(N, dtype=int), np.arange(N) - 1, nothing, nothing, matches, confidence
    )


def submap(start: int, stop: int) -> Submap:
    empty, cells = np.zeros((0, 2)), np.zeros((1, 1), dtype=bool)
    scan = Scan(empty, empty, empty, np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, dtype=int))
    return Submap(start, stop, np.zeros(3), scan, Grid(cells, cells, np.zeros(2), 0.05))


@pytest.fixture(scope="module")
def estimates(recording) -> list[Estimate]:
    matches = np.full(N, 50)
    matches[[10, 20, 21]] = 0
    bent = recording.truth + np.column_stack([np.zeros(N), 0.01 * np.arange(N) ** 1.5, np.zeros(N)])
    return [
        Estimate("ins", bent),
        Estimate("slamstitch", recording.truth, track=track(matches), submaps=(submap(0, 20), submap(22, N))),
    ]


class Page(html.parser.HTMLParser):
    """Tags, attributes and text of a page; refuses unbalanced tags."""

    VOID = ("meta", "img", "br", "link", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.scripts: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] not in ("style", "script"):
            self.text += data
        elif self.open[-1] == "script":
            self.scripts.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attrs for name, attrs in self.tags if name == tag]


def test_table_marks_the_best_in_its_direction():
    metrics = [
        *to_metrics("a", {"ate_rmse": 0.5, "map_f1": 0.5, "segments": 3}),
        *to_metrics("b", {"ate_rmse": 0.4, "map_f1": 0.4, "segments": 2}),
    ]
    table = tabulate(metrics)
    assert table.methods == ("a", "b")
    best = {row.name: [cell.best for cell in row.cells] for row in table.rows}
    assert best == {"ate_rmse": [False, True], "map_f1": [True, False], "segments": [False, False]}


def test_table_marks_all_of_a_tie_and_none_when_all_are_alike():
    def best(*values):
        metrics = [m for i, v in enumerate(values) for m in to_metrics(f"m{i}", {"ate_rmse": v})]
        return [cell.best for cell in tabulate(metrics).rows[0].cells]

    assert best(0.1, 0.1, 0.2) == [True, True, False]
    assert best(0.1, 0.1) == [False, False]


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ((7.3828, 0.04472), ("7.3828", "0.0447")),
        ((1500.0, 213.4), ("1500", "213")),
        ((3.0, 0.0), ("3", "0")),
        ((0.00001, 0.2), ("0.0000", "0.2000")),
        ((12.34, 5.678), ("12.34", "5.68")),
    ],
)
def test_numbers_of_a_row_share_their_decimals(values, texts):
    metrics = [m for i, v in enumerate(values) for m in to_metrics(f"m{i}", {"wall_s": v})]
    assert tuple(cell.text for cell in tabulate(metrics).rows[0].cells) == texts


def test_metrics_nobody_has_are_listed_once_with_their_reason():
    metrics = [
        *missing("a", ("map_f1", "map_iou"), "no truth"),
        *missing("b", ("map_f1", "map_iou"), "no truth"),
        *to_metrics("a", {"ate_rmse": 1.0}),
        *missing("b", ("ate_rmse",), "it failed"),
    ]
    table = tabulate(metrics)
    assert table.absent == (("no truth", ["map_f1", "map_iou"]),)
    (row,) = table.rows
    assert [(cell.text, cell.reason) for cell in row.cells] == [("1", None), ("–", "it failed")]


def test_a_metric_without_a_definition_is_still_shown():
    table = tabulate([Metric("my_metric", 2.0, "m", "lower", None, "a")])
    assert table.rows[0].name == "my_metric"


def test_console_table_shows_markup_as_text():
    text = tabulate(to_metrics("[red]x[/red]", {"ate_rmse": 0.25})).to_table("run [bold]").console()
    assert "[red]x[/red]" in text
    assert "run [bold]" in text
    assert re.search(r"ate_rmse ↓ +m +0\.250", text)


@pytest.mark.parametrize("columns", ["40", "80", "300"])
def test_no_number_is_cut_short_however_narrow_the_console(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    methods = [f"method{i} (published)" for i in range(8)]
    values = {"relation_clear_trans_mean": 1234.5678, "peak_mb": 98765.0}
    tabulate([m for method in methods for m in to_metrics(method, values)]).to_table("title").print()
    printed = capsys.readouterr().out
    assert printed.count(" 1235 ") == 8
    assert printed.count("98765") == 8
    assert "…" not in printed
    assert len({line.count("(published)") for line in printed.splitlines()} - {0}) == 1


def test_verdict_names_the_best_and_by_how_much():
    metrics = [
        m
        for name, v in (("ins", 0.5), ("wsm", 0.4), ("oracle", 0.01))
        for m in to_metrics(name, {"ate_rmse": v})
    ]
    assert verdict(metrics) == (
        "wsm is best: position error (ATE) 0.400 m, 1.2 times better than dead reckoning (0.500 m)."
    )


def test_verdict_admits_that_dead_reckoning_won():
    metrics = [m for name, v in (("ins", 0.051), ("wsm", 0.3)) for m in to_metrics(name, {"ate_rmse": v})]
    assert verdict(metrics).startswith("No method improves on dead reckoning: position error (ATE) 0.051 m")


def test_verdict_falls_back_on_relations_and_then_on_the_eye():
    assert "relations 0.045 m" in verdict(to_metrics("a", {"relation_trans_mean": 0.045}))
    assert verdict(missing("a", ("ate_rmse",), "no truth")).startswith("Nothing to score against")


def test_verdict_tells_of_cuts_and_stitches(estimates):
    counts = {"stitches_tried": 5, "stitches_accepted": 3, "stitches_false": 0}
    ours = to_metrics("slamstitch", {"ate_rmse": 0.1, **counts})
    theirs = to_metrics("htms", {"ate_rmse": 1.0, **counts, "stitches_false": 2})
    assert verdict([*ours, *theirs], estimates) == (
        "slamstitch is best: position error (ATE) 0.100 m; 1 cut, 3 of 5 stitches accepted, 0 false. "
        "htms accepted 2 false stitches."
    )


def test_scores_are_told_beside_dead_reckoning_the_best_first():
    values = {"ins": 0.5, "wsm": 1.0, "mine": 0.25, "oracle": 0.1}
    metrics = [m for name, v in values.items() for m in to_metrics(name, {"ate_rmse": v})]
    found = scores(headline(metrics), [*values, "unscored"])
    assert [(s["method"], s["versus"], s["best"]) for s in found] == [
        ("oracle", "5 times better", False),
        ("mine", "2 times better", True),
        ("ins", "dead reckoning", False),
        ("wsm", "2 times worse", False),
        ("unscored", "not scored", False),
    ]
    assert len({s["colour"] for s in found}) == 5
    assert scores(headline([]), ["ins"]) == []


def test_differences_are_to_dead_reckoning():
    values = {"ins": (0.5, 0.5, 2.0), "wsm": (0.25, 1.0, 1.0), "htms": (10.0, 0.0, 1.0)}
    names = ("ate_rmse", "map_f1", "wall_s")
    metrics = [m for k, v in values.items() for m in to_metrics(k, dict(zip(names, v, strict=True)))]
    told = {row.name: [cell.versus for cell in row.cells] for row in tabulate(metrics).rows}
    assert told == {
        "ate_rmse": ["", "-50 %", "×20"],
        "map_f1": ["", "+100 %", "-100 %"],
        "wall_s": ["", "", ""],
    }


def test_every_metric_stands_under_a_heading():
    from scenarios.evaluation import DEFINITIONS

    table = tabulate(to_metrics("a", dict.fromkeys(DEFINITIONS, 1.0)))
    kinds = dict(table.kinds())
    assert sorted(row.name for rows in kinds.values() for row in rows) == sorted(DEFINITIONS)
    assert [row.name for row in kinds["map"]] == ["map_f1", "map_iou", "map_chamfer", "self_consistency"]


def rendered(recording, estimates, metrics):
    return run_specs(recording, estimates, metrics)[:2]


def test_page_is_one_file_with_every_figure_described(recording, estimates):
    metrics = evaluate(recording, estimates) + cost("ins", 1.0, N, None)
    run = {"command": "python -m scenarios.run drive", "seed": 0}
    drawn = rendered(recording, estimates, metrics)
    text = render(recording, estimates, metrics, run, drawn, stages={"ins": Cost(1.25, None)})
    page = Page(text)
    images = page.all("img")
    assert len(images) == 2
    for image, figure in zip(images, drawn, strict=True):
        assert image["src"].startswith("data:image/png;base64,")
        assert len(image["alt"]) > 20
        assert (int(image["width"]), int(image["height"])) == figure.size
    addresses = [attrs[name] for _, attrs in page.tags for name in ("src", "href") if name in attrs]
    assert all(address.startswith(("data:", "#")) for address in addresses)
    assert "url(" not in text[: text.index("</style>")]
    assert "sourceMappingURL" not in text
    (policy,) = (meta["content"] for meta in page.all("meta") if "http-equiv" in meta)
    assert policy.startswith("default-src 'none';")
    assert "prefers-color-scheme: dark" in text
    assert "slamstitch is best" in page.text
    assert "python -m scenarios.run drive" in page.text
    assert re.search(r"ins\s*1\.25\s*–", page.text)
    for metric in metrics:
        assert metric.name in page.text


def test_every_metric_s_blind_spot_is_told_in_a_line(recording, estimates):
    metrics = evaluate(recording, estimates)
    page = Page(render(recording, estimates, metrics, {}))
    for row in tabulate(metrics).rows:
        assert row.cannot_see
        assert row.cannot_see in page.text


def test_everything_from_outside_is_escaped(recording, estimates):
    attack = "</script><script>alert(1)</script>"
    recording = replace(recording, name=attack)
    estimates = [replace(estimates[0], method=attack)]
    metrics = [*to_metrics(attack, {"ate_rmse": 1.0}), *missing("b", ("ate_rmse",), f'"{attack}')]
    run = {"command": attack, attack: {attack: attack}}
    page = Page(render(recording, estimates, metrics, run, rendered(recording, estimates, metrics)))
    assert [tag.get("type") for tag in page.all("script")] == ["application/json", None]
    assert page.text.count(attack) >= 6
    assert json.loads(page.scripts[0])["methods"][0]["name"] == attack
    assert "alert(1)" not in page.scripts[-1]


def test_page_without_truth_still_shows_the_maps(recording, estimates):
    blind = replace(recording, truth=None)
    page = Page(render(blind, estimates, evaluate(blind, estimates), {}))
    told = json.loads(page.scripts[0])
    assert told["drive"]["truth"] is None
    assert all(method["map"] for method in told["methods"])
    assert "the recording has no truth" in page.text
    assert all("over truth" not in spec.alt for spec in run_specs(blind, estimates, []))


def test_page_of_a_single_scan(recording):
    one = replace(
        recording,
        time=recording.time[:1],
        ranges=recording.ranges[:1],
        dead_reckoning=recording.dead_reckoning[:1],
        truth=recording.truth[:1],
    )
    estimates = [Estimate("ins", one.truth)]
    assert "ins" in Page(render(one, estimates, evaluate(one, estimates), {})).text


def test_page_of_nothing_at_all(recording):
    page = Page(render(recording, [], [], {}))
    assert len(page.all("script")) == 1
    assert "Nothing to score against" in page.text


def test_map_figure_tells_found_wrong_and_missed_walls_apart(recording, estimates):
    figure = draw_maps(recording, estimates, {"ins": "ins", "slamstitch": "slamstitch"})
    bent, exact = ({line.get_color(): len(line.get_xdata()) for line in ax.get_lines()} for ax in figure.axes)
    assert min(bent.values()) > 0
    assert exact[BLUE] == exact[ORANGE] == 0
    assert exact[BLACK] > 0


def test_titles_carry_the_score(recording, estimates):
    metrics = [*to_metrics("ins", {"ate_rmse": 0.25}), *missing("slamstitch", ("ate_rmse",), "why")]
    assert figure_titles(estimates, metrics) == {"ins": "ins\nATE 0.250 m", "slamstitch": "slamstitch"}


def test_titles_are_not_mathematics(recording, estimates):
    named = [replace(estimates[0], method="$a_{$")]
    assert png(draw_trajectories(recording, named, {"$a_{$": "$a_{$"}), dpi=40)


def shaded(ax):
    """First and last x of every band over the panel."""
    (bands,) = ax.collections
    return [(band.vertices[:, 0].min(), band.vertices[:, 0].max()) for band in bands.get_paths()]


def test_confidence_marks_lost_steps_and_cuts(estimates):
    figure = draw_confidence(estimates[1])
    assert len(figure.axes) == 3
    for ax in figure.axes:
        line, dots = ax.get_lines()
        assert dots.get_xdata().tolist() == [10, 20]  # 21 was not tried
        assert dots.get_color() == VERMILLION
        assert set(line.get_xdata().tolist()) == set(range(N)) - set(range(1, N, 4))
        assert shaded(ax) == [(19.5, 21.5)]
        assert not line.get_markevery().any()
    trace = figure.axes[0].get_lines()[0]
    assert np.isnan(trace.get_ydata()[trace.get_xdata() == 10])
    assert figure.axes[0].get_yscale() == figure.axes[1].get_yscale() == "log"


def test_segments_that_touch_are_no_cut(estimates):
    divided = replace(estimates[1], submaps=(submap(0, 20), submap(20, 30), submap(33, N)))
    for ax in draw_confidence(divided).axes:
        assert shaded(ax) == [(29.5, 32.5)]


def test_confidence_of_a_drive_without_any_match(estimates):
    lost = replace(estimates[1], track=track(np.zeros(N, dtype=int)))
    assert png(draw_confidence(lost), dpi=40)


def test_confidence_needs_a_track(estimates):
    with pytest.raises(ValueError, match="ins has no track"):
        draw_confidence(estimates[0])


@pytest.mark.parametrize("count", range(1, 9))
@pytest.mark.parametrize("aspect", [0.3, 1.0, 2.5])
def test_panels_fit_on_a_page(count, aspect):
    figure, axes = panels(count, aspect)
    width, height = figure.get_size_inches()
    assert len(axes) == count
    assert width <= 11.0
    assert height <= 22.0


def test_the_page_opens_with_the_best_but_not_with_dead_reckoning(recording, estimates):
    def opened(ins, ours):
        metrics = [*to_metrics("ins", {"ate_rmse": ins}), *to_metrics("slamstitch", {"ate_rmse": ours})]
        (told,) = (text for text in Page(render(recording, estimates, metrics, {})).scripts if text[0] == "{")
        return json.loads(told)["best"]

    lost = [estimates[0], replace(estimates[1], method="z")]
    assert opened(0.2, 0.1) == opened(0.1, 0.2) == "slamstitch"
    assert '"best":"z"' in render(recording, lost, to_metrics("z", {"ate_rmse": 0.1}), {})
