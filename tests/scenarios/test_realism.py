"""The figures that real and simulated drives are compared by: drives made so that each is known by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.bench import realism
from scenarios.bench.realism import Comparison
from slam import se2
from slam.cli import InputError
from slam.formats import load, recording_npz
from slam.recording import Laser, Recording
from slam.se2 import Array
from slam.table import Table

ROOM = 2.0


def around(scans: int = 400, stride: float = 0.3, turn: float = 0.1) -> Array:
    """A circle, driven round and round."""
    step = np.array([stride, 0.0, turn])
    poses = [np.zeros(3)]
    for _ in range(scans - 1):
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def recording(truth: Array, **changes: object) -> Recording:
    """A drive whose laser sees the same wall all around, whatever the robot does."""
    n, beams = len(truth), 40
    made = Recording(
        name="circle",
        time=0.3 * np.arange(n),
        ranges=np.full((n, beams), ROOM),
        angles=np.linspace(-2.0, 2.0, beams),
        laser=Laser(0.1, 4.0, 0.01),
        dead_reckoning=truth,
        source="ins",
        attitude=np.zeros((n, 2)),
        truth=truth,
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def measure(made: Recording) -> dict[str, float]:
    return {name: value for (name, _), value in realism.measure(made).items()}


def test_steps_turns_and_beams_are_quartiles() -> None:
    truth = around(61)
    truth[41:] = truth[40]  # a third of the drive is a rest
    ranges = np.full((61, 40), ROOM)
    ranges[:20, :10] = np.nan
    found = measure(recording(truth, ranges=ranges))
    assert found["step per scan, 25 %"] == pytest.approx(0.0, abs=1e-9)
    assert found["step per scan, 75 %"] == pytest.approx(0.3, abs=0.01)
    assert found["turn per scan, 75 %"] == pytest.approx(np.degrees(0.1), abs=0.3)
    assert found["valid beams per scan, 25 %"] == 30
    assert found["valid beams per scan, 50 %"] == 40
    assert found["turned per metre driven"] == pytest.approx(np.degrees(0.1 / 0.3), rel=0.03)


def test_steps_without_a_match_are_counted_among_those_that_were_tried() -> None:
    truth = around(41, stride=0.3, turn=0.0)
    ranges = np.full((41, 40), ROOM)
    ranges[21:] = np.nan
    found = measure(recording(truth, ranges=ranges))
    assert found["steps without a match"] == pytest.approx(50.0, abs=3.0)
    assert found["matches per step, 25 %"] == 0
    assert found["matches per step, 75 %"] > 10


def test_yaw_error_grows_with_turning() -> None:
    truth = around()
    turned = 0.1 * np.arange(len(truth))
    ins = truth + np.stack([0 * turned, 0 * turned, 0.02 * turned], -1)
    ins[:, 2] = se2.wrap(ins[:, 2])
    found = measure(recording(truth, dead_reckoning=ins))
    for statistic in ("mean", "median"):
        name = f"INS yaw error gained per radian turned, {statistic}"
        assert found[name] == pytest.approx(np.degrees(0.02), rel=0.05)
    assert found["INS yaw error after 100 m"] == pytest.approx(np.degrees(0.02 * 100 / 3.0), rel=0.03)
    assert found["INS position error after 100 m"] == pytest.approx(0.0, abs=0.02)


def test_a_shock_counts_in_the_mean_not_in_the_median() -> None:
    truth = around()
    jump = np.where(np.arange(len(truth)) > 200, np.deg2rad(11.0), 0.0)
    found = measure(recording(truth, dead_reckoning=truth + np.stack([0 * jump, 0 * jump, jump], -1)))
    assert found["INS yaw error gained per radian turned, median"] < 0.1
    assert found["INS yaw error gained per radian turned, mean"] > 0.2


def test_position_error_is_that_at_100_m_from_the_start() -> None:
    truth = around(stride=0.5)
    offset = np.zeros_like(truth)
    offset[:, 0] = 5.0  # where an INS begins is no error
    offset[:, 1] = 0.3 * np.arange(len(truth)) / 200  # 100 m are 200 steps
    found = measure(recording(truth, dead_reckoning=truth + offset))
    assert found["INS position error after 100 m"] == pytest.approx(0.3, abs=0.02)
    short = measure(recording(truth[:50]))
    assert np.isnan(short["INS position error after 100 m"])


def test_tilt_is_shaking_not_an_offset_and_not_a_fall() -> None:
    truth = around(200)
    rng = np.random.default_rng(0)
    attitude = np.deg2rad(5.0) * rng.standard_normal((200, 2))
    as_it_is = measure(recording(truth, attitude=attitude))
    assert as_it_is["|roll| 50 % quantile"] == pytest.approx(5.0 * 0.674, rel=0.2)
    assert as_it_is["|pitch| 99 % quantile"] == pytest.approx(5.0 * 2.58, rel=0.25)
    leaning = attitude + np.deg2rad([11.0, 0.0])
    assert measure(recording(truth, attitude=leaning))["|roll| 90 % quantile"] == pytest.approx(
        as_it_is["|roll| 90 % quantile"], rel=0.05
    )
    upset = attitude.copy()
    upset[100:110, 0] = np.pi - 0.1
    assert measure(recording(truth, attitude=upset))["|roll| 99 % quantile"] < 20.0


def test_comparison_says_whether_the_quartiles_lie_around_the_real_figure() -> None:
    def figure(real: float | None) -> Comparison:
        return Comparison("steps", "m", real, 1.0, 2.0, 3.0, 0.5, 4.0)

    assert [figure(real).bracketed for real in (None, 2.5, 3.5, 4.5)] == [None, "quartiles", "range", "no"]


def test_quartiles_are_over_the_simulated_drives() -> None:
    drives = [recording(around(30, stride)) for stride in (0.1, 0.2, 0.3, 0.4, 0.5)]
    figures = {figure.name: figure for figure in realism.compare(drives[1], drives)}
    step = figures["step per scan, 50 %"]
    assert (step.least, step.low, step.median, step.high, step.most) == pytest.approx(
        (0.1, 0.2, 0.3, 0.4, 0.5), abs=0.01
    )
    assert step.real == pytest.approx(0.2, abs=0.01)
    assert "INS yaw error after 100 m" not in figures  # all too short
    assert {figure.real for figure in realism.compare(None, drives[:1])} == {None}
    assert len(Table.of(figures.values(), realism.COLUMNS).rows) == len(figures)


def test_truth_is_needed() -> None:
    with pytest.raises(ValueError, match="expected a recording with truth"):
        realism.measure(replace(recording(around(5)), truth=None))


@pytest.mark.parametrize(
    ("log", "seeds", "scenario", "message"),
    [
        ("nowhere.log", 1, "hospital", "nowhere.log: no such file"),
        ("blind.npz", 1, "hospital", "blind.npz: no truth, expected"),
        (None, 0, "hospital", "--seeds: expected 1 or more, got 0"),
        (None, 1, "hospitl", "did you mean 'hospital'"),
    ],
)
def test_bad_input(log: str | None, seeds: int, scenario: str, message: str, tmp_path: Path) -> None:
    recording_npz.write(tmp_path / "blind.npz", replace(recording(around(5)), truth=None))
    with pytest.raises(InputError, match=message):
        realism.against_simulated(None if log is None else tmp_path / log, seeds, scenario)


def test_figures_of_experiment_1(shared_data: Path) -> None:
    real = load(shared_data / "usarsim/iro2012-pre2/Robot1.log")
    found = {name: value for (name, _), value in realism.measure(real).items()}
    assert found["INS position error after 100 m"] == pytest.approx(0.16, abs=0.02)
    assert found["INS yaw error after 100 m"] == pytest.approx(14.9, abs=0.7)
    assert found["valid beams per scan, 50 %"] == pytest.approx(184, abs=2)
    assert 0.5 < found["steps without a match"] < 5.0
    assert found["|roll| 90 % quantile"] < 0.6 < found["|pitch| 99 % quantile"]
