"""The study of methods: its figures by hand, its rows, and trials that fail."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios import source
from scenarios.ablate.options import MethodsOptions as Options
from scenarios.ablate.study.methods import (
    EVERYWHERE,
    LAST,
    DriveResult,
    MethodVariant,
    PairedRatio,
    checked,
    compare_methods,
    method_variants,
    print_ranking,
    run,
    run_trial,
    simulate_recording,
    summarise,
)
from scenarios.methods import METHODS, Method
from scenarios.source import Source
from scenarios.sweep import sweep
from slam.cli import InputError
from slam.recording import Laser, Recording

LINE = np.column_stack([0.1 * np.arange(30.0), np.zeros(30), np.zeros(30)])


def drive(scenario: str, seed: int, method: str, ate: float, **values: float) -> DriveResult:
    return DriveResult(scenario, seed, method, {"ate_rmse": ate, **values}, seconds=float(seed))


def drifting(scenario: str, seed: int, *unused: object) -> Source:
    """A stand-in for the simulator: a wall ahead, and dead reckoning that drifts by ``seed`` mm a scan."""
    ranges = np.tile(np.linspace(2.0, 3.0, 40), (len(LINE), 1))
    reckoned = LINE + np.outer(np.arange(30.0), [0.0, 1e-3 * seed, 0.0])
    angles = np.linspace(-1.0, 1.0, 40)
    recording = Recording(
        scenario, np.arange(30.0), ranges, angles, Laser(), reckoned, "odometry", truth=LINE
    )
    return Source(recording, {})


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """No simulation, and an ``icp`` that fails on seed 1, in the rehearsal too."""

    def dies(recording: Recording, config: object) -> object:
        if np.isclose(recording.dead_reckoning[-1, 1], 0.029):
            raise RuntimeError("no\nluck")
        return METHODS["ins"](recording, config)  # type: ignore[arg-type]

    monkeypatch.setattr(source, "simulated", drifting)
    monkeypatch.setitem(METHODS, "icp", Method("icp", dies))


ROWS = [
    drive("hospital", 0, "ins", 0.2),
    drive("hospital", 0, "wsm", 0.1),
    drive("hospital", 0, "slamstitch", 0.05, map_f1=0.9, stitches_accepted=5, stitches_false=1, anees=0.5),
    drive("hospital", 1, "ins", 0.1),
    drive("hospital", 1, "wsm", 0.3),
    drive("hospital", 1, "slamstitch", 0.04, map_f1=0.7, stitches_accepted=7, stitches_false=0, anees=2.5),
    drive("hospital", 2, "ins", 0.3),
    drive("hospital", 2, "wsm", 0.1),
    DriveResult("hospital", 2, "slamstitch", error="RuntimeError: no"),
    drive("outdoor", 3, "ins", 0.1),
    drive("outdoor", 3, "wsm", 0.5),
    drive("outdoor", 3, "slamstitch", 0.2, map_f1=0.8, stitches_accepted=0, stitches_false=0),
]
THREE = method_variants(["ins", "wsm", "slamstitch"], ["gnc"], 0.0)


def test_standings_by_hand() -> None:
    found = {(one.scenario, one.method): one for one in summarise(ROWS)}
    ours = found["hospital", "slamstitch"]
    assert (ours.drives, ours.failed) == (2, 1)
    assert ours.ate_rmse == pytest.approx(0.045)
    assert (ours.worst_ate_rmse, ours.worst_ate_drive) == (0.05, "hospital 0")
    assert ours.map_f1 == pytest.approx(0.8)
    assert (ours.worst_map_f1, ours.worst_map_drive) == (0.7, "hospital 1")
    assert (ours.false, ours.accepted) == (1, 12)
    assert ours.anees == pytest.approx(1.5)
    assert ours.seconds == pytest.approx(0.5)
    ins = found["hospital", "ins"]
    assert (ins.ate_rmse, ins.worst_ate_drive, ins.accepted, ins.false) == (0.2, "hospital 2", None, None)
    assert np.isnan([ins.map_f1, ins.anees, ins.anees_last, *ins.band]).all()
    everywhere = found[EVERYWHERE, "slamstitch"]
    assert (everywhere.drives, everywhere.worst_ate_drive) == (3, "outdoor 3")
    assert (everywhere.false, everywhere.accepted) == (1, 12)


def test_the_last_poses_have_the_band_of_as_many_drives() -> None:
    rows = [drive("hospital", k, "slamstitch", 0.1, **{LAST: nees}) for k, nees in enumerate([3.0, 6.0])]
    (found,) = summarise([*rows, drive("hospital", 2, "slamstitch", 0.1, **{LAST: float("nan")})])
    assert found.anees_last == pytest.approx(1.5)
    assert found.band == pytest.approx((1.2373 / 6, 14.4494 / 6), rel=1e-4)  # χ²₆


def test_comparisons_by_hand() -> None:
    """Of three drives in the hospital ours finished two: 0.05 and 0.04 m."""
    found = {(c.scenario, c.against): c for c in compare_methods(ROWS, THREE, np.random.default_rng(0))}
    against_ins = found["hospital", "ins"]
    assert against_ins.drives == 2
    assert against_ins.ratio == pytest.approx((0.25 + 0.4) / 2)
    assert against_ins.interval == pytest.approx((0.25, 0.4))
    assert (against_ins.better, against_ins.worst_drive) == (1.0, "hospital 1")
    best = found["hospital", "better of ins and wsm"]
    assert best.ratio == pytest.approx((0.5 + 0.4) / 2)
    assert (best.worst, best.worst_drive) == (pytest.approx(0.5), "hospital 0")
    everywhere = found[EVERYWHERE, "better of ins and wsm"]
    assert everywhere.drives == 3
    assert everywhere.ratio == pytest.approx(0.5)
    assert everywhere.better == pytest.approx(2 / 3)
    assert (everywhere.worst, everywhere.worst_drive) == (pytest.approx(2.0), "outdoor 3")
    assert np.isnan(found["outdoor", "ins"].interval).all()


def test_injection_is_compared_with_the_same_without() -> None:
    both = method_variants(["slamstitch"], ["gnc", "none"], 0.5)
    assert [one.name for one in both] == [
        "slamstitch",
        "slamstitch +50%",
        "slamstitch none",
        "slamstitch none +50%",
    ]
    rows = [drive("hospital", 0, one.name, 0.1 * (k + 1)) for k, one in enumerate(both)]
    found = compare_methods(rows, both, np.random.default_rng(0))
    assert [(c.method, c.against, round(c.ratio, 3)) for c in found] == [
        ("slamstitch", "slamstitch none", 0.333),
        ("slamstitch +50%", "slamstitch", 2.0),
        ("slamstitch none +50%", "slamstitch none", 1.333),
    ]
    assert [one.config().slam.loops.back_end for one in both] == ["gnc", "gnc", "none", "none"]
    assert [one.injected for one in both] == [0.0, 0.5, 0.0, 0.5]


def test_a_row_has_every_metric_and_what_is_asked_of_the_last_pose(quick: None) -> None:
    trial = MethodVariant("ins", "ins").trial("hospital", 2)
    row = DriveResult.of(trial, run_trial(trial, simulate_recording("hospital", 2)))
    assert (row.scenario, row.seed, row.method, row.error) == ("hospital", 2, "ins", "")
    assert 0.0 < row.value("ate_rmse") < 0.06
    assert 0.0 <= row.seconds < 1.0
    assert np.isnan(row.value("stitches_false"))
    assert np.isnan(row.value(LAST))


def test_a_simulation_that_fails_is_everybodys_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*unused: object) -> None:
        raise ValueError("no way out")

    monkeypatch.setattr(source, "simulated", breaks)
    swept = sweep(
        [one.trial("hospital", 2) for one in THREE], run_trial, None, prepare=simulate_recording, workers=1
    )
    rows = [DriveResult.of(*failed) for failed in swept.failed]
    assert [row.method for row in rows] == ["ins", "wsm", "slamstitch"]
    assert {row.error for row in rows} == {"ValueError: no way out"}


def test_what_a_contestant_is_counts_as_its_trial() -> None:
    both = [one.trial("hospital", 2) for one in method_variants(["slamstitch"], ["gnc", "none"], 0.5)]
    assert len({trial.key for trial in both}) == 4
    again = MethodVariant(both[3].method, **both[3].config)
    assert again.config() == method_variants(["slamstitch"], ["none"], 0.5)[1].config()
    assert again.injected == 0.5


@pytest.mark.parametrize("form", ["table", "json"])
def test_trials_that_fail_are_counted_and_the_others_go_on(
    quick: None, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four drives by two methods, one of which fails on seed 1."""
    options = Options(
        "hospital,outdoor", "2", methods="ins,icp", workers=1, format=form, out=tmp_path / "new"
    )  # type: ignore[arg-type]
    with pytest.raises(SystemExit) as stop:
        run(options)
    assert stop.value.code == 1
    with (tmp_path / "new" / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["scenario"], row["seed"], row["method"]) for row in rows[:4]] == [
        ("hospital", "0", "ins"),
        ("hospital", "0", "icp"),
        ("hospital", "1", "ins"),
        ("hospital", "1", "icp"),
    ]
    assert [row["error"] for row in rows[2:4]] == ["", "RuntimeError: no luck"]
    assert float(rows[2]["ate_rmse"]) > 0.0
    assert rows[3]["ate_rmse"] == ""
    assert float(rows[2]["seconds"]) >= 0.0
    printed = capsys.readouterr()
    assert "2 of 8 trials failed, the first: hospital 1 icp: RuntimeError: no luck\n" in printed.err
    assert "seconds per trial: ins " in printed.err
    if form == "json":
        content = json.loads(printed.out)
        assert [(one["scenario"], one["seed"], one["method"]) for one in content["failed"]] == [
            ("hospital", 1, "icp"),
            ("outdoor", 1, "icp"),
        ]
        failing = next(one for one in content["standings"] if one["method"] == "icp")
        assert (failing["drives"], failing["failed"], failing["anees"]) == (1, 1, None)
    else:
        assert "1 (1 failed)" in printed.out


def test_no_number_is_cut_short(capsys: pytest.CaptureFixture[str]) -> None:
    """However narrow the terminal and long the names."""
    name = "slamstitch pcm_gnc +50%"
    rows = [drive("office_smoke", 100 + k, name, 1.234, map_f1=0.56, anees=1878.91) for k in range(2)]
    rows += [drive("two_drives", 107, name, 1.2, map_f1=0.5, stitches_accepted=120, stitches_false=108)]
    pair = PairedRatio(
        "office_smoke", name, "slamstitch pcm_gnc", 2, 1.0, (0.5, 2.0), 0.5, 46.57, "hospital 9"
    )
    print_ranking("title", summarise(rows), [pair])
    printed = capsys.readouterr().out
    assert "…" not in printed
    for shown in ("1.234 (office_smoke 100)", "1.234 (100)", "1878.91", "108/120", "1.00 [0.50, 2.00]"):
        assert shown in printed


def test_without_a_failure_the_exit_is_quiet_and_again_nothing_is_run(
    quick: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = Options("hospital", "2,4", methods="ins", workers=1, out=tmp_path)
    run(options)
    printed = capsys.readouterr()
    assert "hospital" in printed.out
    results = (tmp_path / "results.csv").read_bytes()
    monkeypatch.setattr(source, "simulated", None)
    run(options)
    again = capsys.readouterr()
    assert again.out == printed.out
    assert "0 trials ran, 2 were answered before" in again.err
    assert (tmp_path / "results.csv").read_bytes() == results


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (Options(scenarios="hospitl"), "did you mean 'hospital'?"),
        (Options(methods="ins,oracel"), "did you mean 'oracle'?"),
        (Options(variant="gcn"), "unknown variant 'gcn'"),
        (Options(seeds="9-1"), "--seeds '9-1'"),
        (Options(inject=1.0), "--inject 1: expected a share of at least 0 and below 1"),
        (Options(inject=float("nan")), "--inject nan"),
        (Options(methods="ins", inject=0.5), "expected it among --methods"),
        (Options(methods="ins", variant="none"), "expected it among --methods"),
        (Options(workers=-1), "--workers >= 0"),
        (Options(out=Path(__file__)), "expected a folder, found a file"),
    ],
)
def test_bad_input_is_refused_before_anything_is_done(options: Options, complaint: str) -> None:
    with pytest.raises(InputError) as refusal:
        checked(options)
    assert complaint in str(refusal.value)


def test_bad_input_is_one_line_and_exit_code_2(ablate: Callable[..., Any]) -> None:
    done = ablate("methods", "--methods", "slamstich")
    assert done.code == 2
    assert done.stderr == "scenarios.ablate methods: unknown method 'slamstich': did you mean 'slamstitch'?\n"
    assert done.stdout == ""
