"""The segmentation study: its labels, its statistics by hand, what cutting does, and the command."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.ablate.options import ConfidenceOptions, SegmentationOptions
from scenarios.ablate.segmentation.findings import (
    Findings,
    ScoredDrive,
    analyse,
    correlations,
    decision,
    score_measure,
)
from scenarios.ablate.segmentation.page import draw_pictures, render
from scenarios.ablate.segmentation.table import RESULT_COLUMNS, result_rows, verdict
from scenarios.ablate.segmentation.trials import (
    LEAN,
    NEVER,
    TRUTH,
    LabelledDrive,
    Steps,
    label_drive,
    map_with_cuts,
    predict_failures,
    segments_from,
    splice_dead_reckoning,
    steps_of,
)
from scenarios.ablate.statistics import Mean
from scenarios.ablate.study import confidence, segmentation
from scenarios.ablate.study.confidence import FEATURES, combined, fit_combination, learn_thresholds
from scenarios.catalogue import CATALOGUE
from scenarios.evaluation.segmentation import purity, true_errors
from scenarios.evaluation.trajectory import aligned
from slam import se2
from slam.cli import InputError
from slam.odometry.confidence import MEASURES
from slam.odometry.segmentation import THRESHOLDS, Segment
from slam.odometry.track import Track, Verdict

Beginning = Callable[[str, float], Any]
NAN, INF = np.nan, np.inf


def track(poses: np.ndarray, reference: list[int], verdict: list[int]) -> Track:
    n = len(poses)
    nothing = np.zeros((n, 3, 3))
    return Track(poses, np.array(verdict), np.array(reference), nothing, nothing, np.zeros(n, dtype=int), {})


@pytest.fixture(scope="module")
def drive(begun: Beginning) -> LabelledDrive:
    """The beginning of a drive through rubble, where ManifoldSLAM is soon lost."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(CATALOGUE, "collapsed", begun("collapsed", 78.0))
        return label_drive("collapsed", 100)


# What is called lost


def test_an_error_is_that_of_the_accepted_step() -> None:
    truth = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    poses = np.array([[0.0, 0, 0], [1.0, 0.1, 0], [2.0, 0.1, 0], [3.0, 0.1, np.radians(-10.0)]])
    found = true_errors(track(poses, [-1, 0, 1, 1], [2, 0, 0, 0]), _Truth(truth))  # type: ignore[arg-type]
    np.testing.assert_allclose(found, [NAN, 0.5, 0.0, 2.0], atol=1e-12)


class _Truth:
    name = "made"

    def __init__(self, truth: np.ndarray) -> None:
        self.truth = truth


def test_purity_by_hand() -> None:
    truth = np.stack([np.arange(10.0), np.zeros(10), np.zeros(10)], axis=1)
    poses = truth.copy()
    poses[3:, 1] += 0.5  # between the pieces: nobody's fault
    poses[7:, 0] += 0.4  # inside the second
    found = purity([Segment(0, 3), Segment(3, 9)], poses, truth)
    assert (found.count, found.kept) == (2, 0.9)
    assert found.pure == pytest.approx(3 / 9)
    assert found.drift == pytest.approx(6 * 0.4 / 9)
    assert purity([], poses, truth).kept == 0.0


def test_only_what_is_lost_follows_dead_reckoning(drive: LabelledDrive) -> None:
    lost = predict_failures(drive, TRUTH)
    assert 3 < lost.sum() < 150
    new = splice_dead_reckoning(drive.recording, drive.track, lost)
    old = drive.track
    for k in np.flatnonzero(~lost & (old.reference >= 0)):
        j = old.reference[k]
        np.testing.assert_allclose(
            se2.between(new.poses[j], new.poses[k]), se2.between(old.poses[j], old.poses[k]), atol=1e-9
        )
    assert np.all(new.verdict[lost] == Verdict.FELL_BACK)
    # Cut where it was truly lost, the track is no longer torn.
    truth = drive.recording.truth
    assert truth is not None

    def worst(poses: np.ndarray) -> float:
        return float(np.linalg.norm((aligned(poses, truth) - truth)[:, :2], axis=1).max())

    assert worst(new.poses) < 0.6 * worst(
        splice_dead_reckoning(drive.recording, old, np.zeros(len(old), dtype=bool)).poses
    )


def test_without_a_cut_the_track_stays(drive: LabelledDrive) -> None:
    lost = predict_failures(drive, NEVER)
    assert not lost.any()
    same = splice_dead_reckoning(drive.recording, drive.track, lost)
    np.testing.assert_allclose(same.poses, drive.track.poses, atol=1e-9)
    assert len(segments_from(drive.track, lost)) == 1
    everything = np.ones(len(drive.track), dtype=bool)
    poses = map_with_cuts(drive, everything, LEAN)  # no piece is left
    assert poses.shape == drive.track.poses.shape


@pytest.mark.parametrize("name", sorted(MEASURES))
def test_every_measure_can_be_scored_and_cut(drive: LabelledDrive, name: str) -> None:
    steps = steps_of(drive.recording, drive.track)
    scores = score_measure(steps, name)
    assert 0.0 <= scores["auc"] <= 1.0
    made = decision(steps, name)
    assert made is not None
    called = predict_failures(drive, name)[steps.scan]
    assert (made.right, made.wrong) == (int(np.sum(called & steps.lost)), int(np.sum(called & ~steps.lost)))


def test_steps_survive_a_file(drive: LabelledDrive) -> None:
    steps = steps_of(drive.recording, drive.track)
    again = Steps.from_bytes(steps.to_bytes())
    np.testing.assert_array_equal(again.error, steps.error)
    assert list(again.columns) == list(MEASURES)
    for name, column in steps.columns.items():
        np.testing.assert_array_equal(again.columns[name], column)


# Learning


def made_steps(rng: np.random.Generator, n: int = 400, unmatched: int = 10) -> Steps:
    """Steps of which a tenth is lost; innovation tells well, the matches less, the others nothing."""
    lost = rng.random(n) < 0.1
    columns = {name: np.exp(rng.normal(size=n)) for name in MEASURES}
    columns["innovation"] = np.exp(rng.normal(size=n) + 4.0 * lost)
    columns["neg_match_share"] = rng.normal(size=n) * 0.1 - 0.5 + 0.15 * lost
    columns["neg_matches"] = columns["neg_match_share"] * 200.0
    columns["combined"] = np.log(columns["innovation"]) + 2.0 * columns["neg_match_share"]
    columns["zero_match"], columns["zero_run2"] = np.zeros(n), np.zeros(n)
    for column in columns.values():
        column[:unmatched] = INF
    return Steps(np.arange(n), np.where(lost, 3.0, 0.2), columns)


def test_the_fit_finds_what_tells() -> None:
    rng = np.random.default_rng(3)
    examples = {"a": [made_steps(rng), made_steps(rng)], "b": [made_steps(rng)]}
    weights, bias = fit_combination(examples)
    assert set(weights) == set(FEATURES)
    assert weights["innovation"] > 1.0
    assert weights["neg_match_share"] > 2.0
    assert abs(weights["e_opt"]) < 0.3
    odds = combined(examples["a"][0], weights, bias)
    assert np.all(odds[:10] == INF)
    # The odds are honest: as many are lost as they say.
    chance = 1.0 / (1.0 + np.exp(-odds[10:]))
    assert chance.mean() == pytest.approx(examples["a"][0].lost[10:].mean(), abs=0.03)
    learnt = learn_thresholds(examples, weights, bias)
    assert learnt["zero_match"] == learnt["zero_run2"] == INF
    assert abs(learnt["combined"]) < 1.5  # a step that is as likely lost as not
    with pytest.raises(ValueError, match="one kind"):
        fit_combination({"a": [replace(examples["b"][0], error=np.zeros(400))]})


# What is said of it


@pytest.fixture(scope="module")
def told() -> Findings:
    """Ten drives of two scenarios, in which cutting by the combination helps and by the trace harms."""
    rng = np.random.default_rng(4)
    made = []
    for seed in range(10):
        base = float(np.exp(rng.normal(-3.0, 0.3)))
        factors = {"combined": 0.7, "trace2": 2.0, "neg_matches": 1.0, NEVER: 1.0, TRUTH: 0.6}
        cuts = {
            name: {"ate_rmse": base * factor * float(np.exp(0.05 * rng.normal())), "map_f1": 0.9, "pieces": 3,
                   "kept": 0.9, "pure": 0.0, "drift": 0.1, "seconds": 1.0}
            for name, factor in factors.items()
        }  # fmt: skip
        made += [ScoredDrive(name, seed, made_steps(rng), cuts, 500, 1) for name in ("a", "b")]
    return analyse(made, ["trace2", "neg_matches", "combined"])


def test_the_verdict_says_what_the_numbers_support(told: Findings) -> None:
    text = " ".join(verdict(told))
    assert text.startswith("combined finds lost steps best")
    assert "surely more than any other; neg_matches is next" in text
    assert "beats Formsma's: trace2" in text
    assert "smaller than uncut by combined" in text
    assert "larger than uncut by trace2" in text
    assert "neg_matches (×" not in text  # alike
    assert "lost at 20 of 10000" in text
    assert "nan" not in text.lower()


def test_with_few_drives_the_verdict_claims_nothing(told: Findings) -> None:
    few = analyse(told.drives[:2], told.names)
    text = " ".join(verdict(few))
    assert "cannot be told apart" in text
    assert "does not surely beat" in text
    assert "No measure makes the final map surely better or worse" in text
    assert "nan" not in text.lower()


def test_nothing_lost_is_nothing_said() -> None:
    quiet = replace(made_steps(np.random.default_rng(5)), error=np.zeros(400))
    found = analyse([ScoredDrive("a", 0, quiet, {}, 10, 0)], ["trace2", "combined"])
    assert verdict(found)[0].startswith("No drive has both")
    assert found.line("trace2").decision is not None


def test_measures_without_a_number_do_not_disturb_the_order(told: Findings) -> None:
    names = ["trace2", "zero_match", "combined", "zero_run2", "neg_matches", "tilt"]
    found = analyse(told.drives, names)
    ranked = found.ranked()
    assert ranked[:2] == ["combined", "neg_matches"]
    assert set(ranked) == {"combined", "neg_matches", "trace2", "tilt"}
    scores = [found.line(name).means["auc_matched"].mean for name in ranked]
    assert scores == sorted(scores, reverse=True)


def test_decisions_are_of_all_steps_together(told: Findings) -> None:
    made = told.line("combined").decision
    assert made is not None
    called = [
        np.isposinf(d.steps.columns["combined"]) | (d.steps.columns["combined"] > THRESHOLDS["combined"])
        for d in told.drives
    ]
    right = sum(int(np.sum(some & d.steps.lost)) for some, d in zip(called, told.drives, strict=True))
    assert made.right == right
    assert told.line("combined").means["pure"].mean == 0.0  # a zero is a number


def test_correlations_are_symmetric_and_one_with_themselves(told: Findings) -> None:
    matrix = correlations(told.drives, told.names)
    assert matrix.shape == (4, 4)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(np.diag(matrix), 1.0)


def test_the_page_stands_alone(told: Findings) -> None:
    shown = draw_pictures(told)
    assert [one.name for one in shown] == ["precision_recall", "downstream", "correlation", "timeline"]
    about = {"command": "python -m scenarios.ablate <segmentation>", "cost": "cheap", "thorough": False}
    page = render(told, verdict(told), shown, **about)
    assert page.count("data:image/png;base64,") == 4
    assert "http://" not in page
    assert "https://" not in page
    assert "&lt;segmentation&gt;" in page
    assert "combined finds lost steps best" in page


def test_results_have_a_row_for_every_drive_and_cutter(told: Findings) -> None:
    rows = list(result_rows(told))
    assert len(rows) == 20 * 5
    first = rows[0]
    assert set(first) == set(RESULT_COLUMNS)
    assert (first["scenario"], first["seed"], first["measure"]) == ("a", 0, "trace2")
    assert float(str(first["ate_rmse"])) == pytest.approx(told.values["ate_rmse"]["trace2"][0])
    assert rows[3]["measure"] == NEVER
    assert "auc" not in rows[3]


def test_the_comparison_is_the_same_whatever_the_order(told: Findings) -> None:
    again = analyse(told.drives, told.names)
    assert again.ranking == told.ranking
    assert again.line("combined").means["auc_matched"] == told.line("combined").means["auc_matched"]
    assert isinstance(again.line(TRUTH).means["log_ate"], Mean)


# The command


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"measures": "trace3"}, "did you mean 'trace2'?"),
        ({"scenarios": "hospitl"}, "did you mean 'hospital'?"),
        ({"seeds": "0"}, "at least one"),
        ({"seeds": "5-3"}, "expected first-last"),
        ({"workers": -1}, "workers"),
    ],
)
def test_bad_input_is_refused_before_anything_is_done(
    tmp_path: Path, options: dict[str, str], complaint: str
) -> None:
    with pytest.raises(InputError, match=re.escape(complaint)):
        segmentation.run(SegmentationOptions(out=tmp_path / "out", **options))  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_nothing_is_learnt_from_reported_seeds() -> None:
    with pytest.raises(InputError, match="from 100 on"):
        confidence.run(ConfidenceOptions(seeds="3"))


def test_the_command(
    ablate: Callable[..., Any], begun: Beginning, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CATALOGUE, "collapsed", begun("collapsed", 60.0))
    command = ["segmentation", "--scenarios", "collapsed", "--seeds", "101-101", "--measures"]
    command += ["neg_matches,combined", "--no-maps", "--workers", "1", "-o", str(tmp_path)]
    done = ablate(*command, "--format", "json")
    assert done.code == 0, done.stderr
    said = json.loads(done.stdout)
    assert {line["measure"] for line in said["measures"]} == {"neg_matches", "combined"}
    names = {"results.csv", "index.html", "precision_recall.png", "correlation.png", "timeline.png"}
    assert names <= {file.name for file in tmp_path.iterdir()}
    before = (tmp_path / "results.csv").read_bytes()
    again = ablate(*command)
    assert again.code == 0, again.stderr
    assert "combined" in again.stdout
    assert (tmp_path / "results.csv").read_bytes() == before
