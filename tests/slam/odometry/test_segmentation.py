"""Cutting a drive where confidence is lost, by hand and on the report's own published matches."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.odometry.confidence import MEASURES
from slam.odometry.segmentation import THRESHOLDS, Segment, SegmentationConfig, lost_steps, segments
from slam.odometry.track import Track, Verdict
from slam.se2 import Array

quick = settings(deadline=None, max_examples=100, derandomize=True)

HandMade = Callable[..., Track]
INF, NAN = np.inf, np.nan
ANY_RULE: tuple[Literal["each_zero", "zero_run", "threshold"], ...] = ("each_zero", "zero_run", "threshold")


@pytest.fixture(scope="session")
def confident(hand_made: HandMade) -> Callable[[list[float]], Track]:
    """Track whose trace is given: NaN = skipped, inf = no match."""

    def confident(trace: list[float]) -> Track:
        column = np.array(trace)
        verdict = np.full(len(column), int(Verdict.MATCHED))
        verdict[np.isposinf(column)] = Verdict.FELL_BACK
        verdict[np.isnan(column)] = Verdict.SKIPPED
        return hand_made(np.zeros((len(column), 3)), verdict, confidence={"trace2": column, "det2": -column})

    return confident


Confident = Callable[[list[float]], Track]


def pieces(track: Track, **settings: object) -> list[tuple[int, int]]:
    return [(s.start, s.stop) for s in segments(track, SegmentationConfig(**settings))]  # type: ignore[arg-type]


def test_each_zero_cuts(confident: Confident) -> None:
    drive = confident([NAN, 1, 1, INF, 1, 1, INF, INF, INF, 1, INF])
    assert pieces(drive) == [(0, 3), (4, 6), (9, 10)]
    np.testing.assert_array_equal(np.flatnonzero(lost_steps(drive)), [3, 6, 7, 8, 10])


def test_only_runs_of_zeros_cut(confident: Confident) -> None:
    drive = confident([NAN, 1, INF, 1, INF, INF, 1, 1, INF, INF, INF, 1])
    assert pieces(drive, rule="zero_run") == [(0, 4), (6, 8), (11, 12)]
    assert pieces(drive, rule="zero_run", run=3) == [(0, 8), (11, 12)]
    assert pieces(drive, rule="zero_run", run=4) == [(0, 12)]


def test_a_skipped_scan_neither_ends_nor_makes_a_run(confident: Confident) -> None:
    drive = confident([NAN, 1, INF, NAN, INF, 1, INF, NAN, 1])
    np.testing.assert_array_equal(
        np.flatnonzero(lost_steps(drive, SegmentationConfig(rule="zero_run"))), [2, 4]
    )


def test_the_threshold_is_exclusive(confident: Confident) -> None:
    drive = confident([NAN, 1, 5, 5.1, 1, INF, 1])
    assert pieces(drive, rule="threshold", threshold=5.0) == [(0, 3), (4, 5), (6, 7)]
    assert pieces(drive, rule="threshold", threshold=0.5, least_steps=0) == [(0, 1)]
    # A failed match is beyond every threshold.
    assert pieces(drive, rule="threshold", threshold=np.inf) == [(0, 5), (6, 7)]


def test_the_measure_is_the_one_asked_for(confident: Confident) -> None:
    drive = confident([NAN, 1, 5, 1])
    assert pieces(drive, rule="threshold", threshold=2.0) == [(0, 2), (3, 4)]
    assert pieces(drive, rule="threshold", threshold=-2.0, measure="det2") == [(2, 3)]


def test_skipped_scans_follow(confident: Confident) -> None:
    # At rest after a match the robot is still in its segment, at rest after a loss it is still lost.
    drive = confident([NAN, NAN, 1, NAN, INF, NAN, NAN, 1, NAN])
    assert pieces(drive) == [(0, 4), (7, 9)]


def test_short_segments_are_discarded(confident: Confident) -> None:
    drive = confident([NAN, 1, 1, 1, INF, 1, 1, INF, 1, NAN, NAN, NAN, INF, 1, 1, 1, 1])
    assert pieces(drive) == [(0, 4), (5, 7), (8, 12), (13, 17)]
    assert pieces(drive, least_steps=2) == [(0, 4), (5, 7), (13, 17)]
    assert pieces(drive, least_steps=3) == [(0, 4), (13, 17)]
    assert pieces(drive, least_steps=5) == []


def test_nothing_lost_is_one_segment(confident: Confident) -> None:
    for rule in ANY_RULE:
        assert pieces(confident([NAN, 1, 1, 1]), rule=rule) == [(0, 4)]


def test_all_lost(confident: Confident) -> None:
    assert pieces(confident([NAN, INF, INF]), least_steps=1) == []
    assert pieces(confident([NAN, INF, INF]), least_steps=0) == [(0, 1)]


def test_a_measure_that_is_unknown_or_was_not_taken_is_named(confident: Confident) -> None:
    with pytest.raises(ValueError, match="measure: unknown 'trace', did you mean 'trace2'"):
        SegmentationConfig(measure="trace")
    with pytest.raises(ValueError, match=r"measure: expected one of \['det2', 'trace2'\], got 'tilt'"):
        segments(confident([NAN, 1]), SegmentationConfig(measure="tilt"))


@quick
@given(
    st.lists(st.sampled_from([NAN, INF, 1.0, 10.0]), min_size=1, max_size=40),
    st.sampled_from(ANY_RULE),
    st.integers(1, 4),
)
def test_segments_are_apart_in_order_and_whole(
    confident: Confident, trace: list[float], rule: Literal["each_zero", "zero_run", "threshold"], run: int
) -> None:
    drive = confident([NAN, *trace])
    config = SegmentationConfig(rule=rule, run=run, threshold=5.0, least_steps=0)
    found, lost = segments(drive, config), lost_steps(drive, config)
    inside = np.zeros(len(drive), dtype=int)
    for segment in found:
        assert 0 <= segment.start < segment.stop <= len(drive)
        inside[segment.start : segment.stop] += 1
    assert np.all(inside <= 1)
    assert list(found) == sorted(found, key=lambda s: s.start)
    tried = ~np.isnan(drive.confidence["trace2"])
    np.testing.assert_array_equal(inside[tried] == 1, ~lost[tried])


# The report's experiments, from its published logs


def published_matches(path: Path) -> Array:
    """Matches of every patch that extended the map; the file is a list without its brackets."""
    if not path.is_file():
        pytest.skip(f"real recording not found: {path}")
    records = json.loads("[" + path.read_text().rstrip()[:-1] + "]")
    return np.array([record["matches"] for record in records if record["extend"]])


@pytest.fixture(scope="session")
def published(shared_data: Path, confident: Confident) -> Callable[[str], Track]:
    def published(name: str) -> Track:
        matches = published_matches(shared_data / "usarsim" / name / "wsm_patches.json")
        return confident(list(np.where(matches == 0.0, INF, 1.0)))

    return published


def test_experiment_1_cuts_at_the_steps_the_report_found(published: Callable[[str], Track]) -> None:
    drive = published("iro2012-pre2")
    assert len(drive) == 182
    np.testing.assert_array_equal(
        np.flatnonzero(lost_steps(drive)), [66, 67, 68, 96, 103, 113, 159, 164, 168, 175]
    )
    assert pieces(drive, least_steps=5) == [
        (0, 66), (69, 96), (97, 103), (104, 113), (114, 159), (169, 175), (176, 182),
    ]  # fmt: skip


def test_experiment_2_cuts_at_runs_of_zeros(published: Callable[[str], Track]) -> None:
    drive = published("smoke-results")
    assert len(drive) == 1002
    lost = lost_steps(drive, SegmentationConfig(rule="zero_run"))
    np.testing.assert_array_equal(np.flatnonzero(lost), [*range(292, 297), 743, 744, 748, 749])
    assert np.sum(lost_steps(drive)) == 40
    # Steps 745-747 are too few to be a map.
    assert pieces(drive, rule="zero_run", least_steps=5) == [(0, 292), (297, 743), (750, 1002)]


def test_bounds_are_plain_integers(confident: Confident) -> None:
    # They are written to JSON.
    (segment,) = segments(confident([NAN, 1, 1]))
    assert segment == Segment(0, 3)
    assert type(segment.start) is type(segment.stop) is int


# Hysteresis, and the thresholds that were learnt


def test_hysteresis_holds_until_the_release(confident: Confident) -> None:
    drive = confident([NAN, 1, 5, 3, NAN, 3, 2, 3, 1, INF, 3, 1])
    rule = SegmentationConfig(rule="threshold", threshold=4.0, release=2.0)
    np.testing.assert_array_equal(np.flatnonzero(lost_steps(drive, rule)), [2, 3, 5, 9, 10])
    # Without hysteresis the same threshold cuts what exceeds it, and no more.
    assert np.flatnonzero(
        lost_steps(drive, SegmentationConfig(rule="threshold", threshold=4.0))
    ).tolist() == [
        2,
        9,
    ]


@given(st.lists(st.sampled_from([NAN, 0.0, 1.0, 2.0, 3.0, INF]), min_size=2, max_size=30))
@quick
def test_hysteresis_against_a_slow_twin(confident: Confident, trace: list[float]) -> None:
    drive = confident(trace)
    rule = SegmentationConfig(rule="threshold", threshold=2.0, release=1.0)
    expected, holding = [], False
    for value in trace:
        if np.isnan(value):
            expected.append(False)
            continue
        holding = value > 2.0 or (holding and value > 1.0)
        expected.append(holding)
    assert lost_steps(drive, rule).tolist() == expected


def test_a_release_above_the_threshold_is_refused() -> None:
    with pytest.raises(ValueError, match="release"):
        SegmentationConfig(rule="threshold", threshold=1.0, release=1.5)


def test_every_measure_has_a_threshold_that_was_learnt() -> None:
    assert set(THRESHOLDS) == set(MEASURES)
    assert THRESHOLDS["zero_match"] == THRESHOLDS["zero_run2"] == INF  # the report's rules, as they are
