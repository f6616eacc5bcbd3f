"""Every setting of every method changes an answer: none is dead, and none passes by refusing.

A case is a value with which a method still answers, but not as before; where it is a setting's point to
refuse, the changed value refuses and says so. What is tested beside the stage is only counted here.
"""

from __future__ import annotations

import runpy
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.run import ask_themselves
from sim.laser import Raycaster
from slam import se2
from slam.graph.pose_graph import GncConfig
from slam.mapping.self_consistency import SelfConsistencyConfig
from slam.mapping.submap import Submap
from slam.matching import MatchConfig
from slam.odometry.ego_motion_filter import remove_co_moving_points
from slam.odometry.odometry_faults import OdometryFaultConfig
from slam.odometry.odometry_noise import OdometryNoiseConfig
from slam.odometry.recovery import RecoveryConfig
from slam.odometry.tracker import track
from slam.recording import Laser, Recording, Source
from slam.scan import ScanConfig, scans_of
from slam.se2 import Array
from slam.settings import describe, merge
from stitch.align import AlignConfig, NoStitch, Prior, Stitch, align
from stitch.mapping import Estimate, NoEstimate, OnlineMapper
from stitch.mapping.estimate import OnlineResult
from stitch.mapping.offline import build_map
from tests.scenarios.setting_cases import CASES, LIGHTER, ONLINE, PLACES, UNREACHABLE, Case

TESTS = Path(__file__).resolve().parents[1]

ELSEWHERE: dict[type, tuple[str, str]] = {
    ScanConfig: ("slam/test_scan.py", "CHANGED"),
    MatchConfig: ("slam/matching/test_match.py", "CHANGED"),
    GncConfig: ("slam/graph/test_gauss_newton.py", "CHANGED"),
    AlignConfig: ("stitch/alignment/test_config.py", "CASES"),
    RecoveryConfig: ("slam/odometry/test_recovering_tracker.py", "CHANGED"),
    OdometryNoiseConfig: ("slam/odometry/test_odometry_noise.py", "CHANGED"),
    OdometryFaultConfig: ("slam/odometry/test_odometry_faults.py", "CHANGED"),
    SelfConsistencyConfig: ("slam/mapping/test_self_consistency.py", "CHANGED"),
}
"""Classes whose settings have their cases beside the stage: the test's file, and what it calls them."""

# Drives

N = 60
ANGLES = np.radians(np.linspace(-110.0, 110.0, 111))
LASER = Laser(sigma_range=0.01)
MOUNT = np.array([0.3, -0.1, 0.05])
WITH_ROBOT = slice(50, 58)
"""Beams that see what the robot carries."""


def around() -> Array:
    """True poses ``(N, 3)`` on an ellipse in the room, once and a half around."""
    angle = np.linspace(0.0, 2.8 * np.pi, N)
    x, y = 4.0 + 1.3 * np.sin(angle), 3.1 - 0.8 * np.cos(angle)
    return np.column_stack([x, y, np.arctan2(0.8 * np.sin(angle), 1.3 * np.cos(angle))])


def wheels(rng: np.random.Generator) -> Array:
    """What the wheels count: a little too much, with noise."""
    steps = se2.between(around()[:-1], around()[1:]) * [1.04, 1.0, 1.05]
    poses = [around()[0]]
    for step in steps + rng.normal(0.0, 0.004, steps.shape):
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def inertial(rng: np.random.Generator) -> Array:
    """What an INS counts: a position that wanders, a yaw that turns too far."""
    yaw = np.unwrap(around()[:, 2])
    turned = se2.wrap(yaw[0] + 1.08 * (yaw - yaw[0]))
    return np.column_stack([around()[:, :2] + np.cumsum(rng.normal(0.0, 0.003, (N, 2)), axis=0), turned])


def drive(walls: Array, source: Source, mount: Array, blind: slice, tilted: slice) -> Recording:
    """Around the room, with nothing seen at times, and the floor not even at others."""
    rng = np.random.default_rng(4)
    ranges = Raycaster.from_segments(walls).cast(se2.compose(around(), mount), ANGLES, LASER.range_max)
    ranges = ranges + rng.normal(0.0, 0.01, ranges.shape)
    if source == "ins":
        ranges[:, WITH_ROBOT] = 0.8
    ranges[blind] = np.nan
    attitude = np.zeros((N, 2))
    attitude[tilted, 0] = np.radians(9.0)
    reckoned = inertial(rng) if source == "ins" else wheels(rng)
    stated = replace(LASER, mount_source="" if np.any(mount) else "made")
    time = 0.2 * np.arange(N)
    recording = Recording(source, time, ranges, ANGLES, stated, reckoned, "odometry", attitude=attitude)
    return recording.without_dead_reckoning() if source == "none" else replace(recording, source=source)


def rows_of(recording: Recording, rows: np.ndarray) -> Recording:
    """Some scans of a recording."""
    parts = ("time", "ranges", "dead_reckoning", "attitude")
    return replace(recording, **{name: getattr(recording, name)[rows] for name in parts})


def unsigned(recording: Recording) -> Recording:
    """There and half the way back in reverse, with wheels that do not know which way they turn."""
    there_and_back = replace(rows_of(recording, np.r_[0:40, 39:19:-1]), time=recording.time)
    steps = se2.between(there_and_back.dead_reckoning[:-1], there_and_back.dead_reckoning[1:])
    return reckoned(there_and_back, np.column_stack([np.abs(steps[:, 0]), steps[:, 1:]]))


def frozen(recording: Recording, rows: slice) -> Recording:
    """With a dead reckoning that stands still for some steps."""
    steps = se2.between(recording.dead_reckoning[:-1], recording.dead_reckoning[1:])
    steps[rows] = 0.0
    return reckoned(recording, steps)


def reckoned(recording: Recording, steps: Array) -> Recording:
    """With a dead reckoning of other steps ``(N - 1, 3)``."""
    poses = [recording.dead_reckoning[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return replace(recording, dead_reckoning=np.array(poses))


@pytest.fixture(scope="module")
def drives(room: Array) -> dict[str, Recording]:
    nowhere, here = slice(0, 0), np.zeros(3)
    whole = drive(room, "none", here, nowhere, nowhere)
    return {
        "ins": drive(room, "ins", here, slice(24, 26), slice(30, 36)),
        "odometry": drive(room, "odometry", here, slice(24, 26), nowhere),
        "alone": drive(room, "none", here, slice(40, 43), slice(50, 54)),
        "jump": rows_of(whole, np.r_[0:22, 34:N]),
        "mounted": drive(room, "odometry", MOUNT, nowhere, nowhere),
        "unsigned": unsigned(drive(room, "odometry", here, nowhere, nowhere)),
        "exact": replace(drive(room, "odometry", here, nowhere, nowhere), dead_reckoning=around()),
        "frozen": frozen(drive(room, "odometry", here, nowhere, nowhere), slice(20, 32)),
    }


# Answers

Answer = dict[str, Any]
Ask = Callable[[str, MethodConfig], Answer]


class Stubborn:
    """Refuses every other pair when it is asked the first time, and is wrong about one."""

    def __init__(self, config: AlignConfig) -> None:
        self.config = config
        self.asked: Counter[tuple[int, int]] = Counter()

    def __call__(self, a: Submap, b: Submap, prior: Prior | None) -> Stitch | NoStitch:
        pair = a.start, b.start
        self.asked[pair] += 1
        if len(self.asked) % 2 == 0 and self.asked[pair] == 1:
            return NoStitch("not yet")
        result = align(a, b, prior, self.config)
        if len(self.asked) != 3 or not isinstance(result, Stitch):
            return result
        return replace(result, T_a_b=se2.compose(result.T_a_b, [0.4, 0.3, 0.2]))


def map_stubbornly(recording: Recording, config: MethodConfig) -> Estimate:
    mapping = config.slam
    scans = remove_co_moving_points(
        recording, scans_of(recording, mapping.frontend.scan), mapping.ego_motion_filter
    )
    tracked = track(recording, mapping.frontend, scans)
    return build_map(recording, scans, tracked, mapping, Stubborn(mapping.loops.align))


def map_stubbornly_online(recording: Recording, config: MethodConfig) -> Estimate:
    stubborn = Stubborn(config.slam.loops.align)
    mapper = OnlineMapper(recording.laser, ANGLES, config.slam, recording.source, stubborn)
    parts = zip(recording.ranges, recording.time, recording.dead_reckoning, strict=True)
    on_the_way = np.array([mapper.process(*part).pose for part in parts])
    return replace(mapper.estimate(), online=OnlineResult(on_the_way, np.zeros(N)))


def answer_of(estimate: Estimate | NoEstimate) -> Answer:
    """What an estimate says, part by part."""
    if isinstance(estimate, NoEstimate):
        return {"reason": estimate.reason}
    submaps, tried, tracked = estimate.submaps, estimate.stitches, estimate.track
    assert tracked is not None
    assert tracked.matched_share > 0.5
    return {
        "reason": "",
        "poses": estimate.poses,
        "on the way": estimate.poses if estimate.online is None else estimate.online.poses,
        "mount": np.zeros(0) if estimate.laser_mount is None else estimate.laser_mount.sigma,
        "steps": tracked.covariance,
        "innovation": tracked.confidence["innovation"],
        "submaps": np.concatenate(
            [np.array([[s.start, s.stop], s.grid.occupied.shape]) for s in submaps]
            + [s.points.points for s in submaps]
            + [np.zeros((0, 2))]
        ),
        "tried": np.array([(t.a, t.b, t.round, isinstance(t.result, Stitch)) for t in tried]),
        "accepted": np.array([t.accepted for t in tried]),
    }


@pytest.fixture(scope="module")
def ask(drives: dict[str, Recording]) -> Ask:
    """The answer of a scene: "odometry" is our map of that drive, "online ins" that of the method online,
    "icp ins" that of another, "itself ins" what a map of it says of itself; with "stubborn" stitches."""

    @cache
    def ask(scene: str, config: MethodConfig) -> Answer:
        method, _, name = scene.rpartition(" ")
        if name == "stubborn":
            stubborn = map_stubbornly_online if method == "online" else map_stubbornly
            return answer_of(stubborn(drives["odometry"], config))
        method = {"": "slamstitch", "online": "slamstitch_online"}.get(method, method)
        if method == "itself":
            (asked,) = ask_themselves([Estimate("ins", around())], drives[name], config)
            assert isinstance(asked, Estimate)
            assert asked.consistency is not None
            return {"reason": asked.consistency.reason, "figure": np.array([asked.consistency.figure])}
        return answer_of(METHODS[method](drives[name], config))

    return ask


def settings(values: Mapping[str, object]) -> MethodConfig:
    """The defaults with fields set by their dotted keys."""
    config = MethodConfig()
    for key, value in values.items():
        nested: Any = value
        for name in reversed(key.split(".")):
            nested = {name: nested}
        config = merge(config, nested)
    return config


def differ(before: Array, after: Array) -> bool:
    """By more than rounding."""
    return before.shape != after.shape or not np.allclose(before, after, 1e-6, 1e-9, equal_nan=True)


def check(key: str, case: Case, ask: Ask) -> None:
    default = {**LIGHTER, **case.given}
    before, after = (ask(case.scene, settings(given)) for given in (default, {**default, key: case.value}))
    assert before["reason"] == ""
    if case.reason:
        assert case.reason in after["reason"]
    else:
        assert after["reason"] == ""
        assert len(before[case.part]) > 0
        assert len(after[case.part]) > 0
        assert differ(before[case.part], after[case.part])


@pytest.mark.parametrize("key", CASES)
def test_every_setting_changes_an_answer(key: str, ask: Ask) -> None:
    check(key, CASES[key], ask)


@pytest.mark.parametrize("key", PLACES)
def test_every_place_in_the_tree_is_read(key: str, ask: Ask) -> None:
    check(key, PLACES[key], ask)


@pytest.mark.parametrize("key", ONLINE)
def test_the_method_online_reads_it_too(key: str, ask: Ask) -> None:
    case = {**CASES, **PLACES}[key]
    check(key, replace(case, scene=f"online {case.scene}"), ask)


@pytest.mark.parametrize(("place", "method"), [(p, m) for p, some in UNREACHABLE.items() for m in some])
def test_what_nobody_reads_is_of_methods_without_an_answer(place: str, method: str, ask: Ask) -> None:
    assert "dead" in ask(f"{method} alone", MethodConfig())["reason"]


# Nothing is left out


def nested(tree: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Every data class of a tree and where it stands; those of an alignment are one."""
    for f in fields(tree):  # type: ignore[arg-type]
        value, dotted = getattr(tree, f.name), f"{path}.{f.name}".lstrip(".")
        if is_dataclass(value):
            yield dotted, value
            if not isinstance(value, AlignConfig):
                yield from nested(value, dotted)


def own_leaves(config: object) -> set[str]:
    """Names of the settings that a data class has itself; of an alignment those of its parts too, but a
    matcher's."""
    if not isinstance(config, AlignConfig):
        return {f.name for f in fields(config) if not is_dataclass(getattr(config, f.name))}  # type: ignore[arg-type]
    keys = {key for key, _, _ in describe(config)}
    return {"refinement.matcher" if key.startswith("refinement.matcher.") else key for key in keys}


def test_every_class_of_the_tree_has_one_list_of_cases_with_all_its_settings() -> None:
    """A new setting fails here until it has a case, and so does a new class."""
    tree = dict(nested(MethodConfig()))
    cases: dict[type, set[str]] = {}
    for key in CASES:
        place, _, name = key.rpartition(".")
        assert name not in cases.get(type(tree[place]), set()), f"{key} has two cases"
        cases.setdefault(type(tree[place]), set()).add(name)
    assert not cases.keys() & ELSEWHERE.keys()
    for kind, (path, name) in ELSEWHERE.items():
        cases[kind] = set(runpy.run_path(str(TESTS / path))[name])
    for place, config in tree.items():
        assert own_leaves(config) == cases.get(type(config), set()), place


def test_every_place_of_the_tree_has_a_case() -> None:
    tree = {place: config for place, config in nested(MethodConfig()) if own_leaves(config)}
    read = {place for place in tree for key in {**CASES, **PLACES} if key.startswith(f"{place}.")}
    assert read | UNREACHABLE.keys() == tree.keys()
    assert not read & UNREACHABLE.keys()


def test_the_case_of_a_setting_is_not_its_default() -> None:
    values = {key: value for key, value, _ in describe(settings(LIGHTER))}
    for key, case in {**CASES, **PLACES}.items():
        assert case.value != {**values, **case.given}[key], key
