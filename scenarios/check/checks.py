"""What every method promises, a function each.

One that fails raises `BrokenPromiseError`, whose message says what was seen and what the likely cause is; one
that passes returns what it found, in a few words.
"""

from __future__ import annotations

import copy
import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from scenarios.check import drives
from scenarios.methods import Method
from scenarios.methods.config import MethodConfig
from slam import se2
from slam.cli import InputError
from slam.recording import Recording
from slam.se2 import Array
from stitch.mapping.estimate import Estimate, NoEstimate

OUT_OF_ORDER = 0.3
"""Metres that a pose may move when stamps go backwards; the robot drives twice as far in that time."""
LONGEST_REASON = 300


class BrokenPromiseError(Exception):
    """A method does not keep a promise."""


class NotPromisedError(Exception):
    """The method says itself that it does not promise this."""


@dataclass(frozen=True)
class Trial:
    """A method that is tried, and what it says of an easy drive."""

    method: Method

    @cached_property
    def recording(self) -> Recording:
        """The easy drive."""
        return drives.drive()

    @cached_property
    def plain(self) -> Estimate:
        """The method's answer to it, which it must have. Raises `BrokenPromiseError`."""
        return self.answer(self.recording)

    @cached_property
    def again(self) -> tuple[Estimate, float]:
        """The answer a second time, and the wall time [s] that it took: kernels are compiled by then."""
        assert self.plain is not None
        started = time.perf_counter()
        return self.answer(self.recording), time.perf_counter() - started

    def answer(self, recording: Recording) -> Estimate:
        """The method's answer to an easy drive. Raises `BrokenPromiseError` where there is none."""
        found = self.ask(recording)
        if isinstance(found, NoEstimate):
            raise BrokenPromiseError(f"has no answer for an easy drive: {found.reason}")
        return found

    def ask(self, recording: Recording) -> Estimate | NoEstimate:
        """The method's answer to a copy of the recording. Raises `BrokenPromiseError` for an exception and
        for what is no answer."""
        try:
            found: object = self.method(copy.deepcopy(recording), MethodConfig())
        except InputError as error:
            return NoEstimate(self.method.name, str(error))
        except (Exception, SystemExit) as error:
            kind = f"{type(error).__name__}: {' '.join(str(error).split())}"[:LONGEST_REASON]
            expected = "expected an Estimate, or a NoEstimate with the reason"
            raise BrokenPromiseError(f"raised {kind}; {expected}") from error
        if not isinstance(found, Estimate | NoEstimate):
            cause = "expected an Estimate or a NoEstimate: is there no return?"
            raise BrokenPromiseError(f"returned {type(found).__name__}, {cause}")
        return found


def check_a_pose_for_every_scan(trial: Trial) -> str:
    """Poses ``(N, 3)``, finite."""
    poses = np.asarray(trial.plain.poses)
    expect_poses(poses, len(trial.recording))
    return f"{len(poses)} poses for {len(trial.recording)} scans"


def expect_poses(poses: Array, scans: int) -> None:
    """Raises `BrokenPromiseError` for poses that are not finite or not as many as scans."""
    if poses.shape != (scans, 3):
        cause = "are only keyframes answered, or is the first scan left out?"
        raise BrokenPromiseError(f"poses of shape {poses.shape}, expected ({scans}, 3): {cause}")
    if not np.all(np.isfinite(poses)):
        first = int(np.argmin(np.all(np.isfinite(poses), axis=1)))
        raise BrokenPromiseError(
            f"pose {first} is not finite: a division by zero, or an optimiser that diverged?"
        )


def check_its_name_is_its_own(trial: Trial) -> str:
    """The answer is called what the method is called: tables are sorted by it."""
    found, name = trial.plain.method, trial.method.name
    if found != name:
        raise BrokenPromiseError(f"its answer is called {found!r}, expected {name!r}: copied from another?")
    return repr(found)


def check_covariances_are_positive_definite(trial: Trial) -> str:
    """Covariances ``(N, 3, 3)``, of every scan but the first, or none at all."""
    recording, covariance = trial.recording, trial.plain.covariance
    if covariance is None:
        return "states none"
    sigma = np.asarray(covariance)
    if sigma.shape != (len(recording), 3, 3):
        raise BrokenPromiseError(
            f"covariances of shape {sigma.shape}, expected ({len(recording)}, 3, 3): in the plane?"
        )
    if not np.all(np.isfinite(sigma[1:])):
        raise BrokenPromiseError(
            "a covariance is not finite: a singular information matrix that was inverted?"
        )
    if not np.allclose(sigma, np.swapaxes(sigma, 1, 2), rtol=1e-6):
        raise BrokenPromiseError(
            "a covariance is not symmetric: are rows of a Jacobian in another order than columns?"
        )
    least = np.linalg.eigvalsh(sigma[1:])[:, 0]
    if np.any(least <= 0.0):
        scan = int(np.argmin(least)) + 1
        cause = "an information matrix handed out as a covariance, or one that was never filled in?"
        raise BrokenPromiseError(
            f"covariance of scan {scan} has the eigenvalue {least[scan - 1]:.3g}, expected > 0: {cause}"
        )
    return "positive definite"


def check_same_seed_same_bytes(trial: Trial) -> str:
    """The same recording gives the same bytes, twice in one process."""
    first, second = digest(trial.plain), digest(trial.again[0])
    if first != second:
        cause = "a generator without a seed, a global one, a set that is iterated, threads that add up?"
        raise BrokenPromiseError(f"two runs on one recording differ: {cause}")
    return first[:12]


def check_truth_is_not_read(trial: Trial) -> str:
    """Another truth, or none, changes nothing."""
    if trial.method.sees_truth:
        raise NotPromisedError("says that it is told the truth")
    recording, told = trial.recording, digest(trial.plain)
    for other, what in (
        (drives.with_lies(recording), "another truth"),
        (replace(recording, truth=None), "no truth"),
    ):
        if digest(trial.answer(other)) != told:
            raise BrokenPromiseError(f"answers otherwise with {what}: is recording.truth read?")
    return "the same with another truth and with none"


def check_recording_is_untouched(trial: Trial) -> str:
    """The method changes nothing in what it was given."""
    given = drives.drive()
    before = digest(given)
    try:
        trial.method(given, MethodConfig())
    except Exception as error:  # other checks tell of it
        raise NotPromisedError(f"raised {type(error).__name__}") from error
    if digest(given) != before:
        raise BrokenPromiseError(
            "the recording was changed: an operation in place, as ranges[...] = or time.sort()?"
        )
    return "as it was"


def check_time_order_is_untouched(trial: Trial) -> str:
    """Stamps that go backwards change no more than they must: scans keep the order of the file."""
    one = np.asarray(trial.plain.poses)
    other = np.asarray(trial.answer(drives.with_stamps_backwards(trial.recording)).poses)
    expect_poses(other, len(one))
    moved = se2.between(se2.between(one[0], one), se2.between(other[0], other))
    farthest = float(np.hypot(moved[:, 0], moved[:, 1]).max())
    if farthest > OUT_OF_ORDER:
        cause = "are scans sorted by their stamps, or speeds made of differences of stamps?"
        raise BrokenPromiseError(f"stamps that go backwards move a pose by {farthest:.2f} m: {cause}")
    return f"poses move by {farthest:.3f} m at most"


def check_refuses_with_a_reason(trial: Trial) -> str:
    """Where nothing can be known there is no answer, and one line says why."""
    found = trial.ask(drives.of_nothing())
    if isinstance(found, Estimate):
        cause = "NoEstimate(method, reason) is how a method says that it does not know"
        raise BrokenPromiseError(f"has an answer without dead reckoning and with blind scans: {cause}")
    reason = found.reason
    if not reason.strip() or "\n" in reason.strip():
        raise BrokenPromiseError(f"refuses with the reason {reason[:40]!r}, expected one line that says why")
    return reason[:LONGEST_REASON]


def check_takes_a_single_scan(trial: Trial) -> str:
    """One scan is a drive, or is refused."""
    found = trial.ask(drives.of_one_scan())
    if isinstance(found, NoEstimate):
        return f"refused: {found.reason}"
    expect_poses(np.asarray(found.poses), 1)
    return "answered"


def check_survives_a_blind_minute(trial: Trial) -> str:
    """No beam returns for a minute: the drive goes on afterwards, or is refused."""
    recording = drives.with_blind_minute()
    found = trial.ask(recording)
    if isinstance(found, NoEstimate):
        return f"refused: {found.reason}"
    expect_poses(np.asarray(found.poses), len(recording))
    return f"{drives.BLIND_SCANS} blind scans answered"


def check_states_its_cost(trial: Trial) -> str:
    """Wall time of a second run, kernels being compiled, and how it compares with that of the drive."""
    recording, (_, took) = trial.recording, trial.again
    driven = float(recording.time[-1] - recording.time[0])
    return f"{took:.2g} s for {len(recording)} scans, {driven / max(took, 1e-9):.2g} times as fast as driven"


CHECKS: tuple[Callable[[Trial], str], ...] = (
    check_a_pose_for_every_scan,
    check_its_name_is_its_own,
    check_covariances_are_positive_definite,
    check_same_seed_same_bytes,
    check_truth_is_not_read,
    check_recording_is_untouched,
    check_time_order_is_untouched,
    check_refuses_with_a_reason,
    check_takes_a_single_scan,
    check_survives_a_blind_minute,
    check_states_its_cost,
)
"""All of them, in the order in which they are told."""


@dataclass(frozen=True)
class Finding:
    """What came of a check: ``passed``, None where the method does not promise it; and ``words`` about it."""

    check: str
    passed: bool | None
    words: str


def findings(method: Method) -> Iterator[Finding]:
    """What comes of every check, one after the other."""
    trial = Trial(method)
    for check in CHECKS:
        name = check.__name__.removeprefix("check_").replace("_", " ")
        try:
            yield Finding(name, True, check(trial))
        except BrokenPromiseError as broken:
            yield Finding(name, False, str(broken))
        except NotPromisedError as reason:
            yield Finding(name, None, str(reason))


def digest(thing: Any) -> str:
    """What tells the numbers in a data class from all others, to the last bit."""
    whole = hashlib.sha256()
    for part in _numbers(thing):
        whole.update(np.ascontiguousarray(part).tobytes())
    return whole.hexdigest()


def _numbers(thing: Any) -> Iterator[np.ndarray]:
    """Every array and number in a tree of data classes, tuples and mappings, in its order; not durations."""
    if isinstance(thing, np.ndarray | np.generic | int | float):
        yield np.asarray(thing)
    elif is_dataclass(thing):
        for field in fields(thing):
            if field.name != "seconds":
                yield from _numbers(getattr(thing, field.name))
    elif isinstance(thing, tuple | list):
        for item in thing:
            yield from _numbers(item)
    elif isinstance(thing, dict):
        for item in thing.values():
            yield from _numbers(item)
