"""Every setting of every method changes an answer: none is dead, and none passes by refusing.

A case is a value with which a method still answers, but not as before; where it is a setting's point to
refuse, the changed value refuses and says so. What is tested beside the stage is only counted here.
"""

from __future__ import annotations

import runpy
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from sim.laser import Raycaster
from slam import se2
from slam.graph.pose_graph import GncConfig
from slam.mapping.submap import Submap
from slam.matching import MatchConfig
from slam.odometry.ego_motion_filter import remove_co_moving_points
from slam.odometry.tracker import track
from slam.recording import Laser, Recording, Source
from slam.scan import ScanConfig, scans_of
from slam.se2 import Array
from slam.settings import describe, merge
from stitch.align import AlignConfig, NoStitch, Prior, Stitch, align
from stitch.mapping import Estimate, NoEstimate, OnlineMapper
from stitch.mapping.estimate import OnlineResult
from stitch.mapping.offline import build_map

TESTS = Path(__file__).resolve().parents[1]

ELSEWHERE: dict[type, tuple[str, str]] = {
    ScanConfig: ("slam/test_scan.py", "CHANGED"),
    MatchConfig: ("slam/matching/test_match.py", "CHANGED"),
    GncConfig: ("slam/graph/test_gauss_newton.py", "CHANGED"),
    AlignConfig: ("stitch/alignment/test_config.py", "CASES"),
}
"""Classes whose settings have their cases beside the stage: the test's file, and what it calls them."""

LIGHTER = {
    "slam.loops.length": 2.0,
    "slam.loops.candidates": 2,
    "slam.bundle.neighbours": 5,
    "slam.bundle.per_pass": 3,
    "slam.bundle.radii": (0.4, 0.2),
}
"""For a drive of 60 scans: shorter submaps and a lighter bundle."""


@dataclass(frozen=True)
class Case:
    """With the setting at ``value`` what the ``scene`` shows as ``part`` of its answer is another than with
    the default; in both ``given`` are set as well. With a ``reason`` it refuses instead, saying so."""

    value: object
    scene: str = "ins"
    part: str = "poses"
    given: Mapping[str, object] = field(default_factory=dict)
    reason: str = ""


def by_threshold(threshold: float) -> dict[str, object]:
    return {"slam.segmentation.rule": "threshold", "slam.segmentation.threshold": threshold}


ONE_PASS = {"slam.bundle.passes": 1}
SHORT = {"slam.loops.length": 1.0, "slam.loops.candidates": 5, "slam.loops.least_information": 0.0}
SEARCH_ALL = {"slam.loops.max_search": (0.1, 0.01)}
RETRIED = {**SHORT, "slam.loops.retry_distance": 1e-3}
FAIR_MOUNT = {"slam.mount.max_sigma": 0.05}
ZERO_RUN = {"slam.segmentation.rule": "zero_run"}

CASES = {
    "slam.mount.estimate": Case(False, "mounted"),
    "slam.mount.min_steps": Case(1000, "mounted"),
    "slam.mount.min_motion": Case(0.16, "mounted", given=FAIR_MOUNT),
    "slam.mount.cauchy": Case(1.0, "mounted", given=FAIR_MOUNT),
    "slam.mount.max_sigma": Case(1e-4, "mounted"),
    "slam.mount.min_distance": Case(1e9, "mounted"),
    "slam.mount.max_match_sigma": Case(1e-5, "mounted"),
    "slam.mount.correlated": Case(30, "mounted", "mount", given=FAIR_MOUNT),
    "slam.mount.max_yaw_sigma": Case(1e-7, "mounted"),
    "slam.mount.max_yaw": Case(1e-6, "mounted", given=FAIR_MOUNT),
    "slam.mount.min_matched": Case(1.01, "mounted", given=FAIR_MOUNT),
    "slam.mount.max_scale": Case(1.0001, "mounted"),
    "slam.ego_motion_filter.min_shift": Case(0.5),
    "slam.ego_motion_filter.max_scans": Case(1),
    "slam.ego_motion_filter.same_place": Case(0.3),
    "slam.ego_motion_filter.wall_shift": Case(0.3),
    "slam.frontend.seed_mode": Case("absolute"),
    "slam.frontend.reference": Case("scan"),
    "slam.frontend.method": Case("icp"),
    "slam.frontend.covariance": Case("joint", part="steps"),
    "slam.frontend.skip_distance": Case(0.2, given={"slam.frontend.skip_angle": 1.0}),
    "slam.frontend.skip_angle": Case(0.2, given={"slam.frontend.skip_distance": 5.0}),
    "slam.frontend.extend_distance": Case(0.6, given={"slam.frontend.extend_angle": 3.0}),
    "slam.frontend.extend_angle": Case(0.6, given={"slam.frontend.extend_distance": 5.0}),
    "slam.frontend.map_scans": Case(4),
    "slam.frontend.trust_dead_reckoning": Case(False),
    "slam.frontend.tilt_limit": Case(0.2),
    "slam.frontend.tilt_window": Case(5),
    "slam.frontend.max_variance": Case(6.0),
    "slam.frontend.max_innovation": Case(1.0, "odometry"),
    "slam.frontend.calibrate": Case(False),
    "slam.frontend.calibration.scale_sigma": Case(0.01),
    "slam.frontend.calibration.bias_sigma": Case(0.02),
    "slam.frontend.calibration.heading_sigma": Case(0.2),
    "slam.frontend.calibration.yaw_sigma": Case(0.05),
    "slam.frontend.calibration.position_sigma": Case(0.05),
    "slam.frontend.calibration.forgetting": Case(0.9),
    "slam.frontend.calibration.max_innovation": Case(1e-3),
    "slam.frontend.dead_reckoning.ins_walk": Case(5e-3),
    "slam.frontend.dead_reckoning.ins_position_sigma": Case(0.03),
    "slam.frontend.dead_reckoning.ins_yaw_sigma": Case(0.03),
    "slam.frontend.dead_reckoning.ins_turn_share": Case(0.2),
    "slam.frontend.dead_reckoning.odometry_sigma": Case(0.03, "odometry"),
    "slam.frontend.dead_reckoning.odometry_path_share": Case(0.2, "odometry"),
    "slam.frontend.dead_reckoning.odometry_side_share": Case(0.4, "odometry"),
    "slam.frontend.dead_reckoning.odometry_yaw_sigma": Case(0.05, "odometry"),
    "slam.frontend.dead_reckoning.odometry_turn_share": Case(0.4, "odometry"),
    "slam.frontend.dead_reckoning.odometry_yaw_per_metre": Case(0.2, "odometry"),
    "slam.frontend.dead_reckoning.speed_sigma": Case(1.0, "alone"),
    "slam.frontend.dead_reckoning.turn_sigma": Case(1.0, "alone"),
    "slam.frontend.dead_reckoning.least_seconds": Case(0.5, "alone"),
    "slam.frontend.laser_only.search_shift": Case(0.2, "jump"),
    "slam.frontend.laser_only.search_turn": Case(0.1, "jump"),
    "slam.frontend.laser_only.max_unmatched": Case(2, "alone"),
    "slam.frontend.laser_only.max_coasting": Case(0.1, "alone"),
    "slam.frontend.laser_only.coasting_sigma": Case(0.1, "alone"),
    "slam.segmentation.rule": Case("zero_run", part="submaps", given={"slam.segmentation.run": 4}),
    "slam.segmentation.run": Case(3, part="submaps", given=ZERO_RUN),
    "slam.segmentation.measure": Case("det2", part="submaps", given=by_threshold(1e-5)),
    "slam.segmentation.threshold": Case(
        1e-5, part="submaps", given={"slam.segmentation.rule": "threshold"}
    ),
    "slam.segmentation.release": Case(8e-6, part="submaps", given=by_threshold(1.1e-5)),
    "slam.segmentation.least_steps": Case(24, part="submaps"),
    "slam.keyframes.distance": Case(0.4),
    "slam.keyframes.angle": Case(0.6),
    "slam.submaps.resolution": Case(0.2, part="submaps"),
    "slam.submaps.settling_steps": Case(20, part="submaps"),
    "slam.submaps.settling_turn": Case(1e-3, part="submaps"),
    "slam.submaps.gap_spacing": Case(0.2),
    "slam.submaps.redraw_shift": Case(1e-5, part="submaps"),
    "slam.submaps.redraw_turn": Case(1e-5, part="submaps"),
    "slam.odometry.match_inflation": Case(100.0),
    "slam.odometry.coasting_inflation": Case(10.0, "alone"),
    "slam.odometry.worst_variance": Case(1e-3),
    "slam.odometry.local_map_shift": Case(2.0),
    "slam.loops.length": Case(3.0, part="submaps"),
    "slam.loops.reach": Case(0.5, part="tried", given=SHORT),
    "slam.loops.candidates": Case(1, part="tried", given=SHORT),
    "slam.loops.spread": Case(1, part="tried", given=SHORT),
    "slam.loops.window": Case(2.0, "odometry"),
    "slam.loops.window_ins": Case(2.0),
    "slam.loops.window_angle": Case(0.5),
    "slam.loops.inflation": Case(8.0),
    "slam.loops.max_search": Case((0.1, 0.01)),
    "slam.loops.least_belief": Case(100.0, part="tried", given=SEARCH_ALL),
    "slam.loops.trusted_edge": Case(100.0, "online ins"),
    "slam.loops.broken_edge": Case(0.1, "online ins"),
    "slam.loops.rounds": Case(1, "stubborn", "tried", RETRIED),
    "slam.loops.least_information": Case(1.5, part="tried", given=SHORT),
    "slam.loops.stitch_sigmas": Case(
        (0.01, 0.01, 5e-3), part="tried", given={**SHORT, "slam.loops.least_information": 1.5}
    ),
    "slam.loops.retry_distance": Case(1e-3, "stubborn", "tried", SHORT),
    "slam.loops.max_attempts": Case(1, "stubborn", "tried", RETRIED),
    "slam.loops.max_residual": Case((1e-3, 1e-3, 1e-3), part="accepted"),
    "slam.loops.back_end": Case("none", "stubborn", "poses", SHORT),
    "slam.bundle.neighbours": Case(2),
    "slam.bundle.per_pass": Case(1),
    "slam.bundle.reach": Case(0.5),
    "slam.bundle.radii": Case((0.3, 0.1)),
    "slam.bundle.steps": Case(1),
    "slam.bundle.robust": Case(1.0),
    "slam.bundle.fade": Case(5.0),
    "slam.bundle.length": Case(0.2, given={"slam.bundle.fade": 5.0}),
    "slam.bundle.same_side": Case(-0.5),
    "slam.bundle.freeze_ratio": Case(0.2),
    "slam.bundle.least_pairs": Case(70),
    "slam.bundle.match_inflation": Case(100.0),
    "slam.bundle.level_misfit": Case(0.2),
    "slam.bundle.tilt_discount": Case(1.0, given={"slam.bundle.level_misfit": 0.2}),
    "slam.bundle.passes": Case(1),
    "slam.bundle.same_place": Case(0.2, given=ONE_PASS),
    "slam.bundle.same_view": Case(0.1, given=ONE_PASS),
    "slam.bundle.pass_gap": Case(3, given=ONE_PASS),
    "slam.bundle.placed_neighbours": Case(1, given=ONE_PASS),
    "slam.bundle.placed_per_pass": Case(1, given=ONE_PASS),
    "slam.bundle.placed_rounds": Case(1, given=ONE_PASS),
    "slam.rejection.min_matched": Case(0.99, "alone", reason="matched, less than the 99%"),
    "slam.rejection.max_sigma": Case(1e-3, "alone", reason="known to no better than"),
    "slam.online.neighbours": Case(1, "online ins"),
    "slam.online.per_pass": Case(1, "online ins"),
    "slam.online.radii": Case((0.2,), "online ins"),
    "slam.online.max_shift": Case(5e-3, "online ins"),
    "slam.online.max_turn": Case(2e-3, "online ins"),
    "slam.online.match_distance": Case(1.0, "online ins"),
    "slam.online.max_innovation": Case(1e9, "online stubborn", "poses", SHORT),
    "slam.online.tilt_window": Case(3, "online ins"),
    "slam.online.loss_window": Case(2, "online ins", given={**ZERO_RUN, "slam.segmentation.run": 3}),
    "slam.online.settling_updates": Case(
        1, "online stubborn", "on the way", {**SHORT, "slam.online.max_innovation": 1e9}
    ),
    "slam.online.relinearise": Case(0.5, "online ins"),
}  # fmt: skip
"""Every setting but those of `ELSEWHERE`, at the first place where it stands in the tree."""

PLACES = {
    "slam.frontend.scan.neighbourhood": Case(0.1),
    "slam.frontend.match.robust": Case(1.0),
    "slam.loops.align.search.blur": Case(2.0),
    "slam.loops.gnc.inlier_probability": Case(
        1e-3, "stubborn", "poses", {**SHORT, "slam.online.max_innovation": 0.0}
    ),
    "icp.extend_distance": Case(0.6, "icp ins", given={"icp.extend_angle": 3.0}),
    "icp.scan.neighbourhood": Case(0.1, "icp ins"),
    "icp.match.robust": Case(1.0, "icp ins"),
    "icp.calibration.heading_sigma": Case(0.2, "icp ins"),
    "icp.dead_reckoning.ins_yaw_sigma": Case(0.03, "icp ins", "poses", {"icp.trust_dead_reckoning": True}),
    "icp.laser_only.max_coasting": Case(0.1, "icp alone"),
    "manifold.seed_mode": Case("incremental", "wsm ins"),
    "manifold.scan.neighbourhood": Case(0.1, "wsm ins"),
    "manifold.match.levels": Case(((0.2, 1),), "wsm ins"),
    "manifold.calibration.heading_sigma": Case(
        0.2, "wsm ins", given={"manifold.calibrate": True, "manifold.seed_mode": "incremental"}
    ),
    "manifold.dead_reckoning.ins_turn_share": Case(0.2, "wsm ins", "innovation"),
    "htms.segmentation.least_steps": Case(24, "htms ins", "submaps"),
    "htms.align.resolution": Case(0.2, "htms ins"),
}
"""One setting of every further place where a data class of the tree stands: the place is read."""

UNREACHABLE = {"manifold.laser_only": ("wsm", "htms")}
"""Places that nobody reads, as the methods they belong to have no answer without dead reckoning."""

ONLINE = (
    "slam.mount.estimate", "slam.ego_motion_filter.min_shift", "slam.frontend.map_scans",
    "slam.frontend.scan.neighbourhood", "slam.frontend.match.robust",
    "slam.frontend.calibration.heading_sigma", "slam.frontend.dead_reckoning.ins_turn_share",
    "slam.frontend.laser_only.max_coasting", "slam.segmentation.rule", "slam.keyframes.distance",
    "slam.submaps.resolution", "slam.odometry.match_inflation", "slam.loops.window_ins",
    "slam.loops.align.search.blur", "slam.loops.gnc.inlier_probability", "slam.bundle.robust",
    "slam.rejection.min_matched",
)  # fmt: skip
"""Settings of ours that the method online reads as well: one of each place."""


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
    "icp ins" that of another; with "stubborn" stitches."""

    @cache
    def ask(scene: str, config: MethodConfig) -> Answer:
        method, _, name = scene.rpartition(" ")
        if name == "stubborn":
            stubborn = map_stubbornly_online if method == "online" else map_stubbornly
            return answer_of(stubborn(drives["odometry"], config))
        method = {"": "slamstitch", "online": "slamstitch_online"}.get(method, method)
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
