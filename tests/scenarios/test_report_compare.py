"""Runs and sweeps side by side."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest

from scenarios.report import __main__ as command
from scenarios.report import compare
from scenarios.report.compare import collect_results, compare_metrics, strip_plot
from slam.cli import InputError


def a_run(folder: Path, scenario: str, seed: int, values: dict[str, dict[str, float | None]]) -> Path:
    """A run's folder with metrics ``method -> name -> value`` and a page."""
    metrics = [
        {"method": method, "metric": name, "value": value, "unit": "m", "better": "lower"}
        | ({"reason": "why"} if value is None else {})
        for method, numbers in values.items()
        for name, value in numbers.items()
    ]
    place = folder / f"{scenario}-seed{seed}"
    place.mkdir(parents=True)
    told = {"schema": 1, "recording": scenario, "seed": seed, "metrics": metrics}
    (place / "metrics.json").write_text(json.dumps(told))
    (place / "report.html").write_text("")
    return place


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    for seed, error in enumerate((0.1, 0.4, 0.2)):
        a_run(folder, "a_b", seed, {"ins": {"ate_rmse": 1.0}, "mine": {"ate_rmse": error, "map_f1": 0.9}})
    a_run(folder, "other", 0, {"ins": {"ate_rmse": 0.5, "map_f1": 0.2}, "mine": {"ate_rmse": None}})
    (folder / "latest").symlink_to("other-seed0")
    return folder


def report(capsys: pytest.CaptureFixture[str], *words: object, **options: object) -> str:
    command.run(command.Options(tuple(map(str, words)), **options))  # type: ignore[arg-type]
    return capsys.readouterr().out


def test_medians_worst_cases_and_the_best(runs):
    by_name = {c.name: c for c in compare_metrics(collect_results(sorted(runs.iterdir())))}
    assert list(by_name) == ["ate_rmse", "map_f1"]
    rows = dict(by_name["ate_rmse"].rows)
    assert list(rows) == ["a_b", "other", "all"]
    ins, mine = rows["a_b"]
    assert (mine.median, mine.worst[1], mine.worst[0].seed, mine.best) == (0.2, 0.4, 1, True)
    assert (ins.median, ins.best) == (1.0, False)
    assert rows["other"][1].median is None
    assert (rows["all"][0].median, len(rows["all"][0].results)) == (1.0, 4)
    ins, mine = by_name["map_f1"].rows[2][1]
    assert (mine.best, ins.best) == (True, False)  # more is better there


def test_it_is_printed_in_every_form(runs, capsys):
    words = sorted(runs.iterdir())
    table = report(capsys, *words)
    assert re.search(r"a_b +1 / 1 +0\.200 / 0\.400", table)
    markdown = report(capsys, *words, format="markdown")
    assert "| a\\_b | 1 / 1 | **0.200 / 0.400** |" in markdown
    assert "| other | 0.500 | – |" in markdown
    latex = report(capsys, *words, format="latex")
    assert r"a\_b & 1 / 1 & \textbf{0.200 / 0.400} \\" in latex
    assert r"ate\_rmse [m] $\downarrow$" in latex
    assert "–" not in latex
    told = json.loads(report(capsys, *words, format="json"))["comparisons"]
    mine = next(c for c in told if (c["scenario"], c["method"]) == ("a_b", "mine"))
    assert mine | {"values": [0.1, 0.4, 0.2], "worst_seed": 1, "drives": 3} == mine


def test_what_would_break_a_table_is_escaped(tmp_path):
    attack = "a|b_{$%&~^\\"
    a_run(tmp_path, "s", 0, {attack: {"ate_rmse": 1.0}})
    found = compare_metrics(collect_results([tmp_path / "s-seed0"]))
    assert "a\\|b\\_{$%&~^\\\\" in compare.to_text(found, "markdown")
    assert r"a|b\_\{\$\%\&\textasciitilde{}\textasciicircum{}\textbackslash{}" in compare.to_text(
        found, "latex"
    )


def test_the_page_links_the_worst_drive_from_where_it_lies(runs, tmp_path):
    out = tmp_path / "pages" / "compare.html"
    assert str(out) in compare.run(sorted(runs.iterdir()), out, "table")
    text = out.read_text()
    assert 'href="../runs/a_b-seed1/report.html"' in text
    assert text.count("<circle") == 4 + 3 + 3 + 1  # every drive, of both metrics
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert all(re.fullmatch(r"\.\./runs/[a-z_]+-seed\d/report\.html", address) for address in addresses)


def test_the_pages_names_are_escaped(tmp_path):
    attack = "<script>alert(1)</script>"
    place = a_run(tmp_path, "s", 0, {attack: {"ate_rmse": 1.0}})
    told = json.loads((place / "metrics.json").read_text())
    (place / "metrics.json").write_text(json.dumps({**told, "recording": attack}))
    compare.run([place], tmp_path / "c.html", "table")
    text = (tmp_path / "c.html").read_text()
    assert "alert(1)" in text
    assert attack not in text


def test_sweeps_are_read_too(tmp_path):
    with (tmp_path / "results.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["scenario", "seed", "method", "seconds", "error", "ate_rmse", "nees_last"])
        rows.writerows([["s", 0, "m", 1.0, "", 0.25, 3.0], ["s", 1, "m", 1.0, "it failed", "", ""]])
    results = collect_results([tmp_path])
    assert [(r.seed, r.values, r.page) for r in results] == [(0, {"ate_rmse": 0.25}, None), (1, {}, None)]
    (found,) = compare_metrics(results)
    assert len(found.rows[0][1][0].results) == 1


def test_two_answers_to_one_drive_are_told_apart(tmp_path):
    for version, error in (("old", 0.5), ("new", 0.25)):
        a_run(tmp_path / version, "s", 0, {"m": {"ate_rmse": error}})
    results = collect_results([tmp_path / "old" / "s-seed0", tmp_path / "new" / "s-seed0"])
    assert [result.method for result in results] == ["m (old)", "m (new)"]


def test_a_run_is_counted_once_though_a_link_leads_there(runs):
    assert len(collect_results(sorted(runs.iterdir()))) == 2 * 4


def test_the_strip_lies_within_its_axis(runs):
    for comparison in compare_metrics(collect_results(sorted(runs.iterdir()))):
        picture = strip_plot(comparison, lambda result: None)
        ends = [x for _, x in picture["ticks"]]
        assert len(picture["ticks"]) >= 2
        assert all(ends[0] <= dot["x"] <= ends[-1] for dot in picture["dots"])
        assert sum(dot["worst"] for dot in picture["dots"]) == len(picture["medians"])
        assert not picture["logarithmic"]


def test_errors_of_many_sizes_are_shown_on_a_logarithmic_axis(tmp_path):
    for seed, error in enumerate((0.02, 3.0)):
        a_run(tmp_path, "s", seed, {"m": {"ate_rmse": error}})
    (comparison,) = compare_metrics(collect_results(sorted(tmp_path.iterdir())))
    picture = strip_plot(comparison, lambda result: None)
    assert [words for words, _ in picture["ticks"]] == ["0.01", "0.1", "1", "10"]


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("metrics.json", "{", "metrics.json: expected JSON of a run"),
        ("metrics.json", "{}", "metrics.json: expected the metrics of a run"),
        ("results.csv", "scenario,seed\n", "results.csv: expected a column 'method'"),
        ("results.csv", "scenario,seed,method,ate_rmse\ns,x,m,1\n", "results.csv:2: "),
        ("results.csv", "scenario,seed,method\n", "holds no drive"),
        ("other.txt", "", "expected a run, with metrics.json, or a sweep, with results.csv"),
    ],
)
def test_what_is_no_run_is_refused_in_a_line(name, content, complaint, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=re.escape(complaint)):
        collect_results([tmp_path])


def test_old_pages_among_the_runs_are_passed_over(runs, capsys):
    (runs / "compare.html").write_text("")
    assert "ate_rmse" in report(capsys, *sorted(runs.iterdir()))


def test_a_page_that_cannot_be_written_is_bad_input(runs):
    with pytest.raises(InputError, match="cannot be written"):
        command.run(command.Options((str(runs / "latest"),), Path("/proc/none/c.html")))
