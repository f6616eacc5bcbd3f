"""Damaged files of every format are read, or refused in one line; and the bench would see it if not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from scenarios.bench import __main__ as command
from scenarios.bench.fuzzing import worker
from scenarios.bench.fuzzing.mutations import MUTATIONS
from scenarios.bench.fuzzing.samples import recording, samples
from scenarios.bench.result import BenchmarkOptions
from scenarios.bench.suite import fuzz
from slam.cli import main
from slam.formats import FORMATS, load

from .toy_samples import make

TOYS = [kind for kind in make(Path()) if kind != "hang"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return samples(tmp_path_factory.mktemp("good"))


def test_a_few_hundred_damaged_files_do_no_harm():
    results = list(worker.outcomes(seed=18, files=400, workers=2))
    assert [result for result in results if result.failed] == []
    assert sorted(result.index for result in results) == list(range(400))
    assert {result.outcome for result in results} == {worker.READ, worker.REFUSED}
    assert {result.mutation for result in results} == set(MUTATIONS)


def test_every_format_that_is_written_is_damaged(made):
    assert {name for name, form in FORMATS.items() if form.write} <= made.keys()


def test_a_bag_of_ros_1_is_damaged_too(made, tmp_path):
    worker.write(tmp_path / "bag", made["rosbag, ROS 1"].files)
    assert (tmp_path / "bag" / "rosbag.bag").read_bytes().startswith(b"#ROSBAG V2.0\n")
    np.testing.assert_array_equal(load(tmp_path / "bag" / "rosbag.bag").time, recording().time)


@pytest.mark.parametrize("name", MUTATIONS)
def test_damage_is_drawn_from_its_generator_and_takes_anything(name):
    for data in (b"VERTEX 1 2.5 3\nEDGE 1 2\n", b"x", bytes(100)):
        for seed in range(20):
            first, again = (MUTATIONS[name](data, np.random.default_rng(seed)) for _ in range(2))
            assert first == again
    text = b"VERTEX 1 2.5 3\nEDGE 1 2\n"
    assert any(MUTATIONS[name](text, np.random.default_rng(seed)) != text for seed in range(5))


def test_a_file_is_made_again_from_seed_and_index(made):
    assert worker.damaged(made, 3, 17) == worker.damaged(made, 3, 17)
    assert worker.damaged(made, 3, 17)[2] != worker.damaged(made, 4, 17)[2]


def test_what_must_not_happen_is_seen_and_the_rest_goes_on(monkeypatch):
    monkeypatch.setattr(worker, "SECONDS", 1.0)
    results = list(worker.outcomes(seed=0, files=10, workers=1, make=make))
    assert [result.index for result in results] == list(range(10))
    for result in results:
        assert result.outcome in (result.kind, worker.READ)
        assert result.failed == (result.outcome not in (worker.READ, worker.REFUSED))
    assert {result.outcome for result in results} >= set(TOYS)
    failure = next(result for result in results if result.outcome == worker.TRACEBACK)
    assert "KeyError: 'nobody caught this' (toy_samples.py:" in failure.detail


def test_a_failure_ends_with_exit_code_1_and_a_file_that_is_kept(tmp_path, monkeypatch, capsys):
    failure = worker.Outcome(5, "carmen", "cut off", worker.TRACEBACK, "KeyError: 'x'")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fuzz.worker, "outcomes", lambda *_: iter([failure]))
    monkeypatch.setattr(sys, "argv", ["bench", "fuzz", "--files", "1", "--seed", "2"])
    with pytest.raises(SystemExit) as stop:
        main(BenchmarkOptions, command.COMMAND, command.run)
    assert stop.value.code == 1
    assert "1 of 1 files neither read nor refused" in capsys.readouterr().out
    assert any((tmp_path / "runs/fuzz/2-5").iterdir())
