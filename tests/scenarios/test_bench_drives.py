"""The bench of long drives: the drive there and back, and what is printed of its cost."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from scenarios.bench.result import BenchmarkOptions
from scenarios.bench.suite import drives
from scenarios.bench.suite.drives import YAW_WALK, replay_back_and_forth
from scenarios.stages import Stages
from slam import se2
from slam.recording import Laser, Recording


def line(n: int = 20) -> Recording:
    """Along a line, 0.5 m a scan; each scan has its number for a range."""
    poses = np.column_stack([0.5 * np.arange(n), np.zeros(n), np.zeros(n)])
    ranges = np.tile(1.0 + np.arange(float(n))[:, None], (1, 4))
    return Recording("line", 2.0 * np.arange(n), ranges, np.arange(4.0), Laser(), poses, "ins", truth=poses)


def test_it_goes_there_and_back_with_new_noise_and_a_new_drift() -> None:
    once = line()
    far = replay_back_and_forth(once, 3, np.random.default_rng(0))
    assert len(far) == 60
    assert far.distance == pytest.approx(3.0 * once.distance)
    np.testing.assert_array_equal(far.truth[20:40], once.truth[::-1])  # type: ignore[index]
    np.testing.assert_array_equal(far.truth[40:], once.truth)  # type: ignore[index]
    np.testing.assert_array_equal(far.ranges[:20], once.ranges)
    np.testing.assert_array_equal(far.dead_reckoning[:20], once.dead_reckoning)
    noise = far.ranges[20:40] - once.ranges[::-1]
    assert noise.std() == pytest.approx(once.laser.sigma_range, rel=0.3)
    drift = np.diff((far.dead_reckoning - far.truth)[20:], axis=0)  # type: ignore[operator]
    assert drift[:, 2].std() == pytest.approx(YAW_WALK, rel=0.4)
    assert 0.0 < np.abs(drift[:, :2]).max() < 0.1
    np.testing.assert_allclose(np.diff(far.time), 2.0)
    with pytest.raises(ValueError, match="expected 1 time or more, got 0"):
        replay_back_and_forth(once, 0, np.random.default_rng(0))


def test_the_bench_tells_time_memory_and_their_growth(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def method(recording: Recording, config: object) -> None:
        seen.append(recording)
        sum(range(20_000 * len(recording)))

    once = replace(line(), truth=None, dead_reckoning=se2.compose(line().dead_reckoning, [0.0, 0.0, 0.1]))
    monkeypatch.setattr(drives, "METHODS", {"slamstitch": method})
    monkeypatch.setattr("sim.record.simulate", lambda scenario, seed: SimpleNamespace(recording=once))
    found = drives.run(Stages(Console(quiet=True)), BenchmarkOptions())
    assert [len(recording) for recording in seen[1:]] == [20, 200]
    times = {figure.name: figure for figure in found.figures}
    growth = times["10 x as far takes"]
    assert growth.unit == "×"
    assert growth.median == pytest.approx(
        times["10 x hospital: time"].median / times["1 x hospital: time"].median
    )
    assert 2.0 < growth.median < 50.0
