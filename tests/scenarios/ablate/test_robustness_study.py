"""The study of corruptions: its ratios by hand, its sentences, its trials, and what it refuses."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios import source
from scenarios.ablate.options import RobustnessOptions as Options
from scenarios.ablate.robustness.findings import DriveResult, Findings, analyse, verdict
from scenarios.ablate.robustness.page import ratio_table
from scenarios.ablate.robustness.trials import Log, load_drive, run_trial, spoilings, trials
from scenarios.ablate.study.robustness import checked, read_logs, run
from scenarios.source import Source
from slam.cli import InputError
from slam.formats import recording_npz
from slam.recording import Laser, Recording
from stitch.mapping import NoEstimate

N = 70
LINE = np.column_stack([0.1 * np.arange(float(N)), np.zeros(N), np.zeros(N)])


def wavy(scenario: str = "hospital", seed: int = 0, *unused: object) -> Source:
    """A stand-in for the simulator: a wall ahead, and dead reckoning that waves by ``seed`` cm."""
    ranges = np.tile(np.linspace(2.0, 3.0, 40), (N, 1))
    reckoned = LINE + np.outer(np.sin(np.arange(N) / 5.0), [0.0, 0.01 * (seed + 1), 0.0])
    angles = np.linspace(-1.0, 1.0, 40)
    recording = Recording(scenario, np.arange(float(N)), ranges, angles, Laser(), reckoned, truth=LINE)
    return Source(recording, {})


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """No simulation."""
    monkeypatch.setattr(source, "simulated", wavy)


def result(
    method: str, seed: int, error: float, corruption: str = "", level: str = "", **more: Any
) -> DriveResult:
    values = {} if np.isnan(error) else {"ate_rmse": error, "relation_trans_mean": 99.0}
    return DriveResult("hospital", seed, method, corruption, level, values, **more)


NAN = float("nan")
RESULTS = [
    *(result("ins", seed, 0.2) for seed in (0, 1)),
    *(result("slamstitch", seed, 0.1) for seed in (0, 1)),
    result("slamstitch", 0, 0.11, "laser.bias=0.05", "medium"),
    result("slamstitch", 1, 0.13, "laser.bias=0.05", "medium"),
    *(result("ins", seed, 0.2, "laser.bias=0.05", "medium") for seed in (0, 1)),
    result("slamstitch", 0, 0.4, "odometry.late=2", "medium"),
    result("slamstitch", 1, 0.8, "odometry.late=2", "medium"),
    result("ins", 0, 0.5, "odometry.late=2", "medium"),
    result("ins", 1, 0.3, "odometry.late=2", "medium"),
    result("slamstitch", 0, 0.2, "odometry.missing"),
    result("slamstitch", 1, NAN, "odometry.missing", failure="RuntimeError: no"),
    *(result("ins", seed, NAN, "odometry.missing", refused="none") for seed in (0, 1)),
    *(result("slamstitch", seed, NAN, "odometry.frozen=6", unfit="short") for seed in (0, 1)),
    *(result("ins", seed, NAN, "odometry.frozen=6", unfit="short") for seed in (0, 1)),
]


@pytest.fixture
def findings() -> Findings:
    return analyse(RESULTS, {})


def test_ratios_are_to_the_same_drive_clean_and_the_worst_is_first(findings: Findings) -> None:
    assert [row[0].corruption for row in findings.rows] == [
        "odometry.late=2",
        "odometry.missing",
        "laser.bias=0.05",
    ]
    late, ins = findings.rows[0]
    assert (late.method, ins.method) == ("slamstitch", "ins")
    assert (late.drives, late.median, late.worst, late.worst_drive) == (
        2,
        pytest.approx(6.0),
        pytest.approx(8.0),
        "hospital 1",
    )
    assert late.interval == pytest.approx((4.0, 8.0))
    assert ins.median == pytest.approx(2.0)
    missing, without = findings.rows[1]
    assert (missing.drives, missing.refused, missing.failed, missing.median) == (1, 0, 1, pytest.approx(2.0))
    assert (without.drives, without.refused, without.failed) == (0, 2, 0)
    assert np.isnan(without.median)


def test_where_nothing_is_left_comes_first() -> None:
    lost = [result("slamstitch", seed, NAN, "laser.dropped=0.5", refused="lost") for seed in (0, 1)]
    assert analyse([*RESULTS, *lost], {}).rows[0][0].corruption == "laser.dropped=0.5"


def test_a_log_has_one_clean_drive_for_all_seeds() -> None:
    rows = [replace(r, scenario="intel") for r in RESULTS if r.corruption or r.seed == 0]
    found = analyse(rows, {"intel": Log(Path("intel.log"))})
    assert found.rows[0][0].drives == 2
    assert [one.drives for one in found.clean] == [1, 1]


def test_relations_count_where_there_is_no_truth() -> None:
    assert RESULTS[0].error == 0.2
    assert replace(RESULTS[0], values={"relation_trans_mean": 0.3}).error == 0.3


def test_sentences(findings: Findings) -> None:
    ours, ins, against, *rest = verdict(findings)
    assert ours.startswith(
        "slamstitch is hurt most by odometry.late=2: × 6.00 in the median of 2 drives, × 8.00 on hospital 1."
    )
    assert "Under 1 of 3 corruptions at medium severity its error stays within × 1.3 of the clean one" in ours
    assert ours.endswith("beyond × 3: odometry.late=2 (× 6.00).")
    assert ins.endswith("its error stays within × 1.3 of the clean one; none takes it beyond × 3.")
    assert against == (
        "slamstitch is worse than dead reckoning as recorded on 1 of 4 spoilt drives, most on hospital 1 "
        "with odometry.late=2: 0.800 m against 0.300 m."
    )
    assert "ins refuses to answer on 2 spoilt drives: odometry.missing." in rest
    assert "slamstitch broke on 1 spoilt drives, first with RuntimeError: no." in rest
    assert rest[-1].endswith("lacks what would be spoilt: odometry.frozen=6 on hospital.")


def test_the_table_has_a_column_for_each_method(findings: Findings) -> None:
    text = ratio_table(findings).console()
    assert "6.00 [4.00, 8.00]" in text
    assert "8.00 (hospital 1)" in text


def test_trials_of_a_log_are_not_repeated_where_chance_has_no_part(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("x")
    ways = spoilings(["odometry.late", "laser.noise", "odometry.sign"], ["low", "high"])
    assert [how.corruption for how in ways] == [
        "", "odometry.late=1", "odometry.late=5", "laser.noise=0.02", "laser.noise=0.1", "odometry.sign",
    ]  # fmt: skip
    asked = list(trials(["hospital"], {"a": Log(tmp_path / "a.log")}, [7, 8], ways, ["ins"]))
    assert len(asked) == 2 * 6 + 6 + 2
    again = [t.config["corruption"] for t in asked if (t.scenario, t.seed) == ("a", 8)]
    assert again == ["laser.noise=0.02", "laser.noise=0.1"]
    before = asked[-1].key
    (tmp_path / "a.log").write_text("y")
    assert next(iter(trials([], {"a": Log(tmp_path / "a.log")}, [8], ways[-2:-1], ["ins"]))).key != before


def test_a_trial_spoils_as_the_command_line_does(quick: None) -> None:
    from scenarios.corruptions import corrupted, parse_corruptions
    from scenarios.evaluation import evaluate
    from scenarios.methods import METHODS
    from scenarios.methods.config import MethodConfig

    (trial,) = trials(["hospital"], {}, [3], spoilings(["odometry.jumps"], ["low"])[1:], ["ins"])
    row = run_trial(trial, load_drive("hospital", 3, {})).rows[0]
    spoilt = corrupted(wavy("hospital", 3).recording, parse_corruptions(["odometry.jumps=2"]), 3)
    answer = METHODS["ins"](spoilt, MethodConfig())
    assert not isinstance(answer, NoEstimate)
    expected = {metric.name: metric.value for metric in evaluate(spoilt, [answer])}
    assert row["values"]["ate_rmse"] == expected["ate_rmse"] > 0.1


@pytest.mark.parametrize("form", ["table", "json"])
def test_a_small_study(quick: None, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording_npz.write(tmp_path / "drive.npz", wavy(seed=9).recording)
    options = Options(
        scenarios="hospital", seeds="2-3", logs=str(tmp_path / "drive.npz"), methods="ins", workers=1,
        kinds="odometry.jumps,odometry.missing,odometry.frozen,laser.noise", severities="low,high",
        format=form, out=tmp_path / "new",
    )  # type: ignore[arg-type]  # fmt: skip
    run(options)
    printed = capsys.readouterr().out
    with (tmp_path / "new" / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["scenario"] for row in rows} >= {"hospital", "drive", "drive + odometry.jumps=15"}
    assert {row["unfit"] != "" for row in rows if row["corruption"] == "odometry.frozen=6"} == {True}
    page = (tmp_path / "new" / "index.html").read_text()
    assert "ins is hurt most by odometry.jumps=15" in page
    assert "data:image/png;base64," in page
    assert (tmp_path / "new" / "ratios.png").stat().st_size > 5000
    if form == "json":
        content = json.loads(printed)
        assert content["recordings"] == ["hospital", "drive"]
        noise = [one for one in content["ratios"] if one["corruption"] == "laser.noise=0.1"]
        assert [one["median"] for one in noise] == [1.0]  # dead reckoning has no eyes
        assert noise[0]["drives"] == 4
    else:
        assert "ins refuses to answer on 3 spoilt drives: odometry.missing." in printed
        assert str(tmp_path / "new" / "index.html") in printed


def test_nothing_may_be_left_to_spoil(
    quick: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(
        Options(
            "hospital",
            "2",
            kinds="odometry.frozen",
            severities="high",
            methods="ins",
            workers=1,
            out=tmp_path,
        )
    )
    assert "nothing was spoilt" in capsys.readouterr().out
    assert "nothing was spoilt" in (tmp_path / "index.html").read_text()


BAD = {
    "unknown kind": ({"kinds": "laser.nois"}, "unknown kind 'laser.nois': did you mean 'laser.noise'"),
    "unknown severity": ({"severities": "hihg"}, "unknown severity 'hihg': did you mean 'high'"),
    "unknown method": ({"methods": "wsn"}, "did you mean 'wsm'"),
    "missing log": ({"logs": "no.log"}, "--logs no.log: no such file"),
    "relations without logs": ({"relations": "a.relations"}, "expected one for each of 0 --logs, got 1"),
    "nothing": ({"scenarios": ""}, "--scenarios: expected one or more"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_before_anything_is_done(case: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    words, expected = BAD[case]
    with pytest.raises(InputError, match=expected):
        run(Options(**words, out=tmp_path / "new"))  # type: ignore[arg-type]
    assert not (tmp_path / "new").exists()


def test_a_log_that_cannot_be_scored_is_refused(tmp_path: Path) -> None:
    blind = replace(wavy().recording, truth=None)
    recording_npz.write(tmp_path / "blind.npz", blind)
    with pytest.raises(InputError, match=r"blind.npz: has no truth, expected its relations"):
        read_logs(str(tmp_path / "blind.npz"), "")
    recording_npz.write(tmp_path / "hospital.npz", wavy().recording)
    with pytest.raises(InputError, match="'hospital' is already the name"):
        read_logs(str(tmp_path / "hospital.npz"), "")


def test_logs_alone_are_enough(tmp_path: Path) -> None:
    recording_npz.write(tmp_path / "drive.npz", wavy().recording)
    options = Options(scenarios="", seeds="4", logs=str(tmp_path / "drive.npz"), out=tmp_path / "new")
    scenarios, seeds, logs = checked(options)
    assert (scenarios, seeds, list(logs)) == ([], [4], ["drive"])
