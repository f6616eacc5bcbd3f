"""Sweeps in this process: what is kept, reused, refused and told."""

from __future__ import annotations

import math
import re
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scenarios.ablate.options import STUDIES
from scenarios.sweep import Answer, Failure, Trial, check, executors, finish, sweep, version, write_results
from scenarios.sweep.progress import Progress
from scenarios.sweep.run import summary_lines
from scenarios.sweep.store import Store, contents, opened
from slam.cli import InputError

ROOT = Path(__file__).parents[2]


def trials(drives: int = 3, methods: str = "ab") -> list[Trial]:
    return [Trial("toy", "flat", seed, method, {"gain": 2.0}) for seed in range(drives) for method in methods]


def answer(trial: Trial, material: object) -> Answer:
    if trial.method == "x":
        raise ValueError("no\nluck")
    return Answer([{"seed": trial.seed, "material": material}], trial.method.encode())


def shared(scenario: str, seed: int) -> str:
    return f"{scenario}{seed}"


def alone(asked, store: Path | None = None, answer=answer, **more):
    return sweep(asked, answer, store, workers=1, **more)


def test_floats_and_bytes_survive_exactly(tmp_path: Path) -> None:
    """Fresh from the worker and out of the file alike; numpy's numbers become Python's."""
    row = {"a": 0.1 + 0.2, "b": math.nan, "c": -math.inf, "d": 5e-324, "e": True, "f": None, "g": "ü\n"}
    row |= {"h": np.float64(1 / 3), "i": np.int64(7), "j": np.bool_(False), "k": [1, {"l": 2.5}]}
    payload = bytes(range(256))
    for _ in range(2):
        (found,) = alone(trials(1, "a"), tmp_path / "s", lambda *_: Answer([row], payload)).answers
        assert isinstance(found, Answer)
        assert found.payload == payload
        (read,) = found.rows
        assert repr(read) == repr({**row, "h": 1 / 3, "i": 7, "j": False})


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    first = alone(trials(2), tmp_path / "s", prepare=shared)
    assert (first.ran, first.reused) == (4, 0)
    more = alone(trials(3), tmp_path / "s", prepare=shared)
    assert (more.ran, more.reused) == (2, 4)
    asked: list[int] = []
    same = alone(trials(3), tmp_path / "s", prepare=lambda _, seed: asked.append(seed))
    assert (same.ran, same.reused, asked) == (0, 6, [])
    assert same.answers == more.answers
    assert [found.rows[0]["material"] for _, found in same.answered][::2] == ["flat0", "flat1", "flat2"]
    fresh = alone(trials(3), tmp_path / "s", prepare=shared, fresh=True)
    assert (fresh.ran, fresh.reused) == (6, 0)


@pytest.mark.parametrize("changed", ["study", "scenario", "seed", "method", "config"])
def test_every_part_of_the_key_counts(changed: str, tmp_path: Path) -> None:
    parts = {"study": "toy", "scenario": "flat", "seed": 0, "method": "a", "config": {"p": 1, "q": [2, 3]}}
    other = {"study": "n", "scenario": "n", "seed": 1, "method": "b", "config": {"p": 1, "q": [2, 4]}}[
        changed
    ]
    alone([Trial(**parts)], tmp_path / "s")
    assert alone([Trial(**(parts | {"config": {"q": [2, 3], "p": 1}}))], tmp_path / "s").reused == 1
    assert alone([Trial(**(parts | {changed: other}))], tmp_path / "s").ran == 1


def test_a_drive_is_prepared_once_and_only_for_what_is_left(tmp_path: Path) -> None:
    prepared = []

    def prepare(scenario: str, seed: int) -> str:
        prepared.append(seed)
        return shared(scenario, seed)

    alone([Trial("toy", "flat", 0, method, {"gain": 2.0}) for method in "ab"], tmp_path / "s")
    swept = alone(trials(3, "abc"), tmp_path / "s", prepare=prepare)
    assert prepared == [0, 1, 2]
    assert (swept.ran, swept.reused) == (7, 2)


def test_failures_are_kept_told_and_tried_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = tmp_path / "s"
    for _ in range(2):
        swept = alone(trials(2, "ax"), store)
    assert (swept.ran, swept.reused) == (2, 2)
    trial, failure = swept.failed[1]
    assert (trial.seed, trial.method, failure.line) == (1, "x", "ValueError: no luck")
    assert 'raise ValueError("no\\nluck")' in failure.traceback
    with pytest.raises(SystemExit) as stop:
        finish(swept, store)
    assert stop.value.code == 1
    said = capsys.readouterr().err
    assert "2 of 4 trials failed, the first: flat 0 x: ValueError: no luck" in said
    assert f"python -m scenarios.sweep {store}" in said
    shown = "\n".join(contents(store))
    assert "toy a: 2 answered, 0 failed" in shown
    assert "toy x: 0 answered, 2 failed" in shown
    assert shown.count('raise ValueError("no\\nluck")') == 2
    healed = alone(trials(2, "ax"), store, lambda *_: Answer([]))
    assert (healed.ran, healed.reused, healed.failed) == (2, 2, [])
    finish(healed, store)


def test_a_preparation_that_fails_is_every_trials_failure() -> None:
    def prepare(scenario: str, seed: int) -> int:
        return 1 // (seed - 1)

    swept = alone(trials(3), prepare=prepare)
    assert [trial.seed for trial, _ in swept.failed] == [1, 1]
    assert {failure.line for _, failure in swept.failed} == {
        "ZeroDivisionError: integer division or modulo by zero"
    }


def test_an_answer_that_is_no_json_is_a_failure() -> None:
    (found,) = alone(trials(1, "a"), answer=lambda *_: Answer([{"a": object()}])).answers
    assert isinstance(found, Failure)
    assert "expected JSON values" in found.line


def test_what_is_known_decides_what_is_asked(tmp_path: Path) -> None:
    """Trials are drawn one by one, each after everything before it is told; out of the file too."""
    for _ in range(2):
        known: list[int] = []

        def asked(known: list[int] = known) -> Iterator[Trial]:
            for trial in trials(100, "a"):
                if sum(known) > 5:
                    return
                yield trial

        swept = alone(asked(), tmp_path / "s", each=lambda trial, _, known=known: known.append(trial.seed))
        assert known == [0, 1, 2, 3]
        assert [trial.seed for trial in swept.trials] == known


def test_none_is_no_sweep(tmp_path: Path) -> None:
    assert alone([], tmp_path / "s").trials == ()
    assert list(tmp_path.iterdir()) == []


def test_other_code_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alone(trials(1), tmp_path / "s")
    ours = version.code_version()
    monkeypatch.setattr("scenarios.sweep.store.code_version", lambda: "9.9+abc")
    with pytest.raises(InputError) as refusal:
        alone(trials(1), tmp_path / "s")
    for word in (str(tmp_path / "s"), ours, "9.9+abc", "--out", "--fresh"):
        assert word in str(refusal.value)
    monkeypatch.undo()
    assert alone(trials(1), tmp_path / "s").reused == 2


def test_a_worker_of_other_code_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker of this machine that finds the code edited: the version here is another one."""
    version.code_version.cache_clear()  # as a process that has just been started finds it
    theirs = version.code_version()
    monkeypatch.setattr("scenarios.sweep.scheduler.code_version", lambda: "9.9+abc")
    monkeypatch.setattr("scenarios.sweep.executors.code_version", lambda: "9.9+abc")
    with pytest.raises(InputError, match=re.escape(f"runs slamstitch {theirs}, this is 9.9+abc")):
        sweep(trials(1), check_nothing, None, workers=2)


check_nothing = sum
"""Something that a worker can import; it is never called."""


def test_somebody_elses_files_are_left_alone(tmp_path: Path) -> None:
    other, text = tmp_path / "other", tmp_path / "text"
    with sqlite3.connect(other) as file:
        file.execute("CREATE TABLE diary (day TEXT)")
    file.close()
    text.write_text("Dear diary" * 100)
    before = other.read_bytes(), text.read_bytes()
    for path in (other, text):
        with pytest.raises(InputError, match="expected a file made by a sweep"):
            alone(trials(1), path, fresh=True)
        with pytest.raises(InputError, match="expected a file made by a sweep"):
            list(contents(path))
    assert (other.read_bytes(), text.read_bytes()) == before
    with pytest.raises(InputError):
        list(contents(tmp_path / "nothing"))


def test_a_file_has_one_sweep_at_a_time(tmp_path: Path) -> None:
    alone(trials(1), tmp_path / "s")
    with opened(tmp_path / "s"):
        code = (
            "import sys; from pathlib import Path; from scenarios.sweep.store import opened\n"
            "try:\n    opened(Path(sys.argv[1])).__enter__()\nexcept ValueError as e: print(e)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "s")], capture_output=True, text=True, cwd=ROOT
        )
        assert done.stdout == f"{tmp_path / 's'}: another sweep is writing to it\n"


def test_a_full_disk_keeps_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file may have 40 pages: three for the table, five for each answer."""
    keep = Store.keep

    def small(self: Store, *arguments: object) -> None:
        self.connection.execute("PRAGMA max_page_count = 40")
        keep(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Store, "keep", small)
    with pytest.raises(InputError, match="database or disk is full; 7 answers are kept in"):
        alone(trials(10, "a"), tmp_path / "s", lambda *_: Answer([], b"x" * 20000))
    monkeypatch.undo()
    swept = alone(trials(10, "a"), tmp_path / "s", lambda *_: Answer([], b"x" * 20000))
    assert (swept.ran, swept.reused) == (3, 7)


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        alone(trials(1), tmp_path / "file" / "s")
    (tmp_path / "t.csv").mkdir()
    with pytest.raises(InputError, match="directory"):
        write_results(tmp_path / "t.csv", ["a"], [{"a": 1}])


def test_a_scheduler_that_does_not_answer_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that listens and says nothing: one line soon, and no folder."""
    assert executors.SCHEDULER_TIMEOUT_S < 8.0
    monkeypatch.setattr(executors, "SCHEDULER_TIMEOUT_S", 0.5)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        where = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        started = time.monotonic()
        with pytest.raises(InputError, match=f"{where}: expected a Dask scheduler"):
            sweep(trials(1), answer, tmp_path / "new" / "s", scheduler=where)
    assert time.monotonic() - started < 8.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((None, -1, Path("new")), "--workers >= 0"),
        (("tcp://host:1", 2, Path("new")), "either it or --scheduler"),
        (("host", 0, Path("new")), "like tcp://host:8786"),
        (("tcp://host:many", 0, Path("new")), "like tcp://host:8786"),
        ((None, 0, Path(__file__)), "expected a folder"),
    ],
)
def test_options_are_checked(arguments: tuple[str | None, int, Path], complaint: str) -> None:
    check("tcp://host:8786", 0, Path("new"))
    with pytest.raises(InputError, match=complaint):
        check(*arguments)


def test_the_version_is_that_of_the_code(tmp_path: Path) -> None:
    for name in ("slam/a.py", "scenarios/report/b.py", "sim/c.npz", "sim/__pycache__/d.nbi", "tests/e.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    first = version._hash(tmp_path)
    for name in ("scenarios/report/b.py", "sim/__pycache__/d.nbi", "tests/e.py"):
        (tmp_path / name).write_text("2")
        assert version._hash(tmp_path) == first
    seen = {first}
    for name in ("slam/a.py", "sim/c.npz"):
        (tmp_path / name).write_text("2")
        seen.add(version._hash(tmp_path))
    (tmp_path / "slam/a.py").rename(tmp_path / "slam/z.py")
    assert len(seen | {version._hash(tmp_path)}) == 4


def test_no_trial_imports_what_the_version_leaves_out() -> None:
    """All that the scenarios, methods and scores are made of counts."""
    code = (
        "import sys; import scenarios.ablate.study.methods, scenarios.ablate.study.stitching;"
        "import scenarios.evaluation;"
        "import stitch.mapping.offline, scenarios.methods.htms, scenarios.methods.oracle;"
        "import scenarios.source, scenarios.methods.warm_up, scenarios.sweep.trial, sim.record;"
        "print(*(m.__file__ for m in sys.modules.values() if getattr(m, '__file__', None)), sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = (Path(line) for line in done.stdout.splitlines())
    here = {path.relative_to(ROOT) for path in loaded if path.is_relative_to(ROOT) and path.suffix == ".py"}
    ours = {path for path in here if path.parts[0] in ("sim", "slam", "stitch", "scenarios")}  # not a .venv
    assert len(ours) > 50
    assert ours <= set(version.sources(ROOT))


def test_progress_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten of forty done before, and ten in 100 s: twenty more take 200 s."""
    monkeypatch.setattr(time, "monotonic", lambda: 0.0)
    shown: list[str] = []
    progress = Progress(40, lambda one: shown.append(one.words()), shown.append)
    for _ in range(10):
        progress.reused += 1
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    for k in range(10):
        progress.finished(failed=k == 3)
    assert shown[-1] == "20 of 40 trials, 1 failed, 6.0/min, 3 min left"
    endless = Progress(None, lambda one: None, shown.append)
    endless.finished(failed=False)
    assert endless.words() == "1 trials, 1000.0/s"


def test_the_cost_is_told_by_method() -> None:
    def slow(trial: Trial, material: object) -> Answer:
        time.sleep(0.02 if trial.method == "b" else 0.0)
        return Answer([])

    lines = summary_lines(alone(trials(2), answer=slow, prepare=lambda *_: time.sleep(0.01)), None)
    words = lines[1].split()
    assert lines[0] == "4 trials ran"
    assert words[:4] == ["seconds", "per", "trial:", "a"]
    assert 0.02 <= float(words[6].rstrip(",")) < 0.2
    assert words[-4:-1] == ["preparing", "a", "drive"]


def test_help_loads_nothing_slow() -> None:
    code = (
        "import sys\nfrom scenarios.ablate.__main__ import run\n"
        "for name in sys.argv.pop().split(','):\n"
        "    try:\n        run([name, '--help'])\n    except SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    command = [sys.executable, "-c", code, ",".join(STUDIES)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.count("--fresh") >= 3
    assert not set(done.stderr.split()) & {"dask", "distributed", "numba", "scipy", "cv2", "matplotlib"}
