"""What is told of a map that knows whether it is torn: metric, sentence, page; and the study's figures."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from scenarios.ablate.options import SelfConsistencyOptions
from scenarios.ablate.study.self_consistency import HONEST, MadeMap, run, summarise, trials
from scenarios.evaluation import evaluate
from scenarios.evaluation.self_consistency import self_consistency_metrics, with_self_consistency
from scenarios.report.live import live_content
from scenarios.report.summary import verdict
from slam import se2
from slam.cli import InputError
from slam.mapping.self_consistency import Contradiction, SelfConsistency
from slam.odometry.laser_mount import Mount
from slam.recording import Laser, Recording
from stitch.mapping.estimate import Estimate

N = 40
PLACE = Contradiction(1.0, 2.0, (3, 30), 15.0, 4, "walls seen again 0.40 m beside themselves")
TORN = SelfConsistency(0.1, "", 0.4, 0.2, 0.3, 50, (PLACE,))


@pytest.fixture(scope="module")
def recording() -> Recording:
    angles = np.linspace(-1.5, 1.5, 61)
    truth = np.column_stack([0.1 * np.arange(N), np.zeros(N), np.zeros(N)])
    ranges = np.tile(2.0 + np.cos(3 * angles), (N, 1))
    return Recording("drive", np.arange(N), ranges, angles, Laser(), truth.copy(), truth=truth)


def test_what_cannot_be_told_is_a_reason_and_no_number() -> None:
    assert self_consistency_metrics(TORN) == {"self_consistency": 0.1}
    assert self_consistency_metrics(SelfConsistency(None, "why")) == {"self_consistency": "why"}


def test_an_answer_that_is_there_is_not_asked_for_again(recording: Recording) -> None:
    metrics = evaluate(recording, [Estimate("slamstitch", recording.dead_reckoning, consistency=TORN)])
    assert [m.value for m in metrics if m.name == "self_consistency"] == [0.1]


def test_the_laser_is_where_it_was_found(recording: Recording) -> None:
    turning = np.column_stack([np.zeros((N, 2)), np.linspace(0.0, 12.0, N)])
    turning[:, 0] = np.linspace(0.0, 0.5, N)
    found = Mount(np.array([1.0, 0.0, 0.0]), 1e-4 * np.eye(3))
    here, there = (
        with_self_consistency(Estimate("slamstitch", turning, laser_mount=mount), recording).consistency
        for mount in (None, found)
    )
    assert here != there


def test_the_first_sentence_says_that_our_map_is_torn(recording: Recording) -> None:
    ours = Estimate("slamstitch", recording.dead_reckoning, consistency=TORN)
    text = verdict([], [ours])
    assert text.startswith(
        "The map of slamstitch is torn (self_consistency 0.10); it contradicts itself in one place, most at "
        "(1.0, 2.0) m, scans 3 and 30: walls seen again 0.40 m beside themselves. Nothing to score"
    )
    whole = replace(ours, consistency=SelfConsistency(0.9, ""))
    assert verdict([], [whole]).startswith("Nothing to score")
    assert verdict([], [replace(ours, method="wsm")]).startswith("Nothing to score")


def test_the_places_lie_on_the_page_where_the_map_is_drawn(recording: Recording) -> None:
    T_map_truth = np.array([5.0, -3.0, 1.0])
    moved = Estimate("m", se2.compose(T_map_truth, recording.dead_reckoning), consistency=TORN)
    told = json.loads(json.dumps(live_content(recording, [moved], None, None)))
    (shown,) = told["methods"][0]["contradictions"]
    assert shown["reason"] == PLACE.reason
    assert shown["scans"] == [3, 30]
    (expected,) = se2.transform(se2.inverse(T_map_truth), np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(shown["place"], expected, atol=1e-4)


# The study


def made(corruption: str, ate: float, figure: float, yaw: float = 0.4, method: str = "slamstitch") -> MadeMap:
    return MadeMap("hospital", 20, corruption, method, ate, yaw, figure, 0)


def test_the_figures_of_the_study_by_hand() -> None:
    maps = [
        made(HONEST, 0.02, 0.9),
        made("late", 0.11, 0.2),
        made("slip", 2.0, 0.6),
        made("noise", 0.05, 0.3, yaw=90.0),
        made("frozen", 3.0, np.nan),
        made("late", 0.3, 0.1, method="wsm"),
    ]
    ours, wsm, both = summarise(maps, 5.0)
    assert (ours.maps, ours.without, ours.torn, ours.found, ours.alarms) == (4, 1, 2, 1, 1)
    assert ours.auc == pytest.approx(3.0 / 4.0)
    assert ours.auc_heading == pytest.approx(1.0)
    assert np.isnan(wsm.auc)
    assert (both.method, both.maps, both.torn) == ("all", 5, 3)


def test_the_honest_drive_of_ours_is_always_among_the_trials() -> None:
    planned = trials(["hospital"], [20], ["late"], ["wsm"])
    assert [(t.method, t.config["corruption"]) for t in planned] == [
        ("slamstitch", HONEST), ("wsm", HONEST), ("wsm", "late")
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"corruptions": "fib"}, "unknown corruption 'fib'"),
        ({"times": 1.0}, "--times 1: expected more than 1"),
        ({"methods": "magic"}, "unknown method 'magic'"),
    ],
)
def test_options_that_cannot_be_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(replace(SelfConsistencyOptions(), **wrong))
