"""The bench: the building it measures in, what it does with repetitions, and what it prints."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pymunk
import pytest
from rich.console import Console

from scenarios.bench import __main__ as command
from scenarios.bench import suite
from scenarios.bench.building import building, free_poses
from scenarios.bench.result import BenchmarkOptions, BenchmarkResult, Figure, three_digits, time_calls
from scenarios.bench.suite import sim as bench
from scenarios.stages import Stages, timed
from sim.laser import Raycaster
from slam.cli import main
from slam.table import Table

CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("segments", [4, 13, 77, 200, 2001])
def test_a_building_has_as_many_walls_as_asked_for_and_none_without_length(segments):
    walls = building(segments, np.random.default_rng(0))
    assert walls.shape == (segments, 4)
    assert np.all(np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > 0.1)


def test_buildings_grow_at_constant_density():
    for segments, size in ((200, (40.0, 30.0)), (800, (80.0, 60.0))):
        walls = building(segments, np.random.default_rng(0))
        np.testing.assert_allclose(np.ptp(walls.reshape(-1, 2), axis=0), size)


def test_a_building_is_drawn_from_its_generator():
    a, b, c = (building(200, np.random.default_rng(seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(a, b)
    assert np.any(a != c)


def test_too_small_a_building_is_refused():
    with pytest.raises(ValueError, match="4 or more"):
        building(3, np.random.default_rng(0))


def test_one_sees_out_of_every_room_but_not_out_of_the_building():
    rng = np.random.default_rng(0)
    walls = building(200, rng)
    poses = free_poses(walls, 40, rng)
    ranges = Raycaster.from_segments(walls).cast(poses, np.linspace(-np.pi, np.pi, 721))
    assert np.all(np.isfinite(ranges))
    assert np.all(ranges.max(axis=1) > 5.0)
    assert ranges.min() > 0.35 - 1e-9


def test_figures_are_compared_repetition_by_repetition():
    fast, slow = Figure("fast", "M rays/s", (4.0, 9.0, 2.0)), Figure("slow", "M rays/s", (1.0, 3.0, 1.0))
    assert fast.median == 4.0
    assert fast.per(slow, "fast / slow").values == (4.0, 3.0, 2.0)


def test_a_timed_call_is_called_once_with_its_arguments():
    result, seconds = timed(lambda count: sum(range(count)), 300_000)
    assert result == 44_999_850_000
    assert 0.0 < seconds < 1.0


def test_calls_take_turns_and_the_first_is_not_counted():
    order: list[str] = []
    taken = time_calls({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, repetitions=2)
    assert order == ["a", "b"] * 3
    assert {name: len(times) for name, times in taken.items()} == {"a": 2, "b": 2}


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (0.2514, "0.251"), (31.26, "31.3"), (99.99, "100"), (1234.6, "1235")]
)
def test_numbers_have_three_digits(value, text):
    assert three_digits(value) == text


def test_pymunk_is_asked_for_the_same_ranges():
    """The loop that is timed as the reference finds what the ray caster finds."""
    rng = np.random.default_rng(0)
    walls = building(200, rng)
    (pose,) = free_poses(walls, 1, rng)
    space, found = bench.space_of(walls), []
    spy = SimpleNamespace(segment_query_first=lambda *query: found.append(space.segment_query_first(*query)))
    bench.pymunk_loop(spy, pose[None], 50.0)
    assert isinstance(space, pymunk.Space)
    expected = Raycaster.from_segments(walls).cast([pose], bench.ANGLES)[0]
    np.testing.assert_allclose([50.0 * hit.alpha for hit in found], expected, atol=1e-6)


def test_the_bench_of_the_simulator_has_every_figure(monkeypatch):
    for name, value in {
        "POSES": 4,
        "POSES_OF_LOOP": 2,
        "REPETITIONS": 1,
        "LARGER": (400,),
        "DRIVES": 2,
    }.items():
        monkeypatch.setattr(bench, name, value)
    lasted = SimpleNamespace(recording=SimpleNamespace(time=np.array([1.0, 3.0, 9.0])))
    monkeypatch.setattr(bench, "simulate", lambda scenario, seed: lasted)
    figures = {f.name: f for f in bench.run(Stages(Console(quiet=True)), BenchmarkOptions()).figures}
    for name in (
        "pymunk", "flat", "tilted", "flat, turned", "tilted, hospital", "flat / pymunk", "tilted / pymunk",
        "flat, 200 segments", "flat, 400 segments", "time per ray, 400 / 200 segments",
        "prepare 200 segments", "prepare 400 segments", "hospital, whole simulation",
    ):  # fmt: skip
        assert all(np.isfinite(figures[name].values))
    assert len(figures["hospital, whole simulation"].values) == 2
    assert figures["hospital, whole simulation"].note == "seed 0, 8 s simulated"


def pretend(monkeypatch, *words: str) -> int:
    """Run the command with a bench that measures nothing."""
    figures = [Figure("flat", "M rays/s", (3.0, 1.0, 2.0), "a note")]
    table = Table(("matcher", "easy"), [("ours", "100.0 [98.7–100.0]")], "Success")
    result = BenchmarkResult(
        figures, [table], {"scores": [{"matcher": "ours", "success": 1.0}]}, ["one is left out"]
    )
    monkeypatch.setattr(command, "bench", lambda name: lambda stages, options: result)
    monkeypatch.setattr(sys, "argv", ["bench", *words])
    return main(command.BenchmarkOptions, command.COMMAND, command.run)


def test_the_table_has_median_range_and_machine(monkeypatch, capsys):
    assert pretend(monkeypatch, "sim") == 0
    row, *_, machine = [
        line for line in capsys.readouterr().out.splitlines() if "flat" in line or "Python" in line
    ]
    assert row.split() == ["flat", "2", "1–3", "M", "rays/s", "3", "a", "note"]
    assert "cores, Python 3." in machine


def test_json_has_every_repetition(monkeypatch, capsys):
    assert pretend(monkeypatch, "--format", "json") == 0
    result = json.loads(capsys.readouterr().out)
    assert set(result["benches"]) == set(suite.BENCHES)
    (flat,) = result["benches"]["sim"]
    assert flat == {
        "name": "flat", "unit": "M rays/s", "values": [3.0, 1.0, 2.0], "note": "a note",
        "median": 2.0, "min": 1.0, "max": 3.0,
    }  # fmt: skip
    assert result["environment"]["processor"]
    assert result["records"]["sim"] == {"scores": [{"matcher": "ours", "success": 1.0}]}
    assert result["notes"]["sim"] == ["one is left out"]


def test_tables_and_notes_are_printed_as_they_are(monkeypatch, capsys):
    assert pretend(monkeypatch, "sim") == 0
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert "  ours      100.0 [98.7–100.0]" in lines
    assert "one is left out" in lines
    assert max(map(len, lines)) <= 160


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--pairs", "0"], "--pairs: expected 1 or more, got 0"),
        (["--seed", "-1"], "--seed: expected 0 or more, got -1"),
        (["--data", "nowhere"], "--data: expected a folder, got nowhere"),
        (["--pair", "3"], "unknown option '--pair': did you mean '--pairs'?"),
    ],
)
def test_bad_options_are_one_line_and_exit_code_2(monkeypatch, capsys, words, complaint):
    assert pretend(monkeypatch, "matching", *words) == 2
    assert capsys.readouterr().err == f"scenarios.bench: {complaint}\n"


def test_an_unknown_bench_is_one_line_and_exit_code_2(monkeypatch, capsys):
    assert pretend(monkeypatch, "sin") == 2
    assert capsys.readouterr().err == "scenarios.bench: unknown bench 'sin': did you mean 'sim'?\n"


def test_every_bench_says_what_it_measures():
    for name in suite.BENCHES:
        assert callable(suite.bench(name))
        assert sys.modules[f"scenarios.bench.suite.{name}"].__doc__


def test_help_loads_nothing_slow():
    code = "import sys, runpy; sys.argv = ['bench', '--help']\ntry: runpy.run_module('scenarios.bench')\n"
    code += "finally: print(*sys.modules, file=sys.stderr)"
    finished = subprocess.run(
        [sys.executable, "-c", code], cwd=CHECKOUT, capture_output=True, text=True, check=False
    )
    loaded = set(finished.stderr.split())
    assert loaded & {"numba", "numpy", "scipy", "pymunk", "matplotlib", "rich.table"} == set()
    assert "scenarios.bench.suite" in loaded
