"""Our own methods keep every promise, and a method that breaks one is told which, and why."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from scenarios.check import __main__ as command
from scenarios.check.checks import CHECKS, Finding, findings
from scenarios.methods import METHODS, Method
from scenarios.methods.config import MethodConfig
from slam import se2
from slam.cli import main
from slam.recording import Recording
from stitch.mapping.estimate import Estimate, NoEstimate

Answer = Callable[[Recording, MethodConfig], Estimate | NoEstimate]


@pytest.mark.parametrize("name", METHODS)
def test_our_methods_keep_every_promise(name: str) -> None:
    found = list(findings(METHODS[name]))
    assert [one.words for one in found if one.passed is False] == []
    assert len(found) == len(CHECKS)
    assert [one.check for one in found if one.passed is None] == (
        ["truth is not read"] if METHODS[name].sees_truth else []
    )


def honest(recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
    """Dead reckoning, which refuses where there is none."""
    if recording.source == "none":
        return NoEstimate("mine", "no dead reckoning")
    return Estimate("mine", recording.dead_reckoning, np.tile(np.eye(3), (len(recording), 1, 1)))


def keyframes(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate("mine", recording.dead_reckoning[::2])


def diverged(recording: Recording, config: MethodConfig) -> Estimate:
    poses = recording.dead_reckoning.copy()
    poses[-1] = np.nan
    return Estimate("mine", poses)


def unnamed(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate("ins", recording.dead_reckoning)


def indefinite(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate("mine", recording.dead_reckoning, np.zeros((len(recording), 3, 3)))


def lopsided(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate(
        "mine", recording.dead_reckoning, np.tile(np.eye(3) + np.eye(3, k=1), (len(recording), 1, 1))
    )


def draws() -> Iterator[float]:
    yield from np.random.default_rng(0).normal(size=1000)


LUCK = draws()


def lucky(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate("mine", recording.dead_reckoning + 1e-12 * next(LUCK))


def cheat(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate("mine", recording.dead_reckoning if recording.truth is None else recording.truth)


def careless(recording: Recording, config: MethodConfig) -> Estimate:
    recording.ranges[0, 0] = 1.0
    return Estimate("mine", recording.dead_reckoning)


def sorter(recording: Recording, config: MethodConfig) -> Estimate:
    return Estimate("mine", recording.dead_reckoning[np.argsort(recording.time, kind="stable")])


def silent(recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
    return NoEstimate("mine", "") if recording.source == "none" else honest(recording, config)


def nothing(recording: Recording, config: MethodConfig) -> None:
    pass


def pairwise(recording: Recording, config: MethodConfig) -> Estimate:
    first, second = recording.dead_reckoning[:2]
    return Estimate("mine", se2.compose(first, se2.between(second, recording.dead_reckoning)))


def blind(recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
    return gone() if np.isnan(recording.ranges).all(axis=1).any() else honest(recording, config)


def gone() -> Estimate:
    raise IndexError("list index out of range")


BROKEN: dict[str, tuple[Callable[..., object], str, str]] = {
    "keyframes": (
        keyframes,
        "a pose for every scan",
        r"shape \(30, 3\), expected \(60, 3\): are only keyframes",
    ),
    "diverged": (diverged, "a pose for every scan", "pose 59 is not finite: a division by zero"),
    "unnamed": (unnamed, "its name is its own", "called 'ins', expected 'mine'"),
    "indefinite": (indefinite, "covariances are positive definite", "eigenvalue 0, expected > 0"),
    "lopsided": (lopsided, "covariances are positive definite", "not symmetric"),
    "lucky": (lucky, "same seed same bytes", "two runs on one recording differ: a generator without a seed"),
    "cheat": (cheat, "truth is not read", "answers otherwise with another truth"),
    "careless": (careless, "recording is untouched", "the recording was changed"),
    "sorter": (sorter, "time order is untouched", "are scans sorted by their stamps"),
    "claims": (lucky, "refuses with a reason", "has an answer without dead reckoning and with blind scans"),
    "silent": (silent, "refuses with a reason", "expected one line that says why"),
    "nothing": (nothing, "a pose for every scan", "returned NoneType, expected an Estimate"),
    "pairwise": (pairwise, "takes a single scan", "raised ValueError: not enough values to unpack"),
    "blind": (blind, "survives a blind minute", "raised IndexError: list index out of range"),
}


def of(system: Callable[..., object]) -> dict[str, Finding]:
    return {one.check: one for one in findings(Method("mine", system))}  # type: ignore[arg-type]


def test_an_honest_one_passes() -> None:
    assert all(one.passed for one in of(honest).values())


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_promise_is_told_with_its_likely_cause(name: str) -> None:
    system, check, words = BROKEN[name]
    found = of(system)[check]
    assert found.passed is False
    assert re.search(words, found.words), found.words
    assert "\n" not in found.words


def test_a_module_s_function_is_checked_from_the_shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "my_slam_method.py").write_text(
        "from stitch.mapping.estimate import Estimate\n"
        "def mine(recording, config):\n    return Estimate('mine', recording.dead_reckoning)\n"
        "number = 3\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))

    def check(*words: str) -> int:
        monkeypatch.setattr("sys.argv", ["check", *words])
        return main(command.Options, command.COMMAND, command.run)

    with pytest.raises(SystemExit, match="1"):
        check("my_slam_method:mine", "--format", "json")
    told = json.loads(capsys.readouterr().out)
    assert [one["check"] for one in told["findings"] if not one["passed"]] == ["refuses with a reason"]
    for words, message in (
        ("my_slam_method:yours", "has no attribute 'yours'"),
        ("my_slam_method:number", "expected a function, got int"),
        ("no_such_module:mine", "ModuleNotFoundError"),
        ("slamstich", "did you mean 'slamstitch'?"),
    ):
        assert check(words) == 2
        complaint = capsys.readouterr().err
        assert message in complaint
        assert complaint.count("\n") == 1
