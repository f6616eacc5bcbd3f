"""A value for every setting with which a method answers otherwise; `test_settings` tries them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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
    "slam.frontend.dead_reckoning.doubt": Case((0.05, 0.05), "frozen"),
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
    "slam.mending.recovery.min_contradictions": Case(0, "frozen"),
    "slam.mending.noise.max_scale": Case(0.0, "exact", given={"slam.mending.noise.min_steps": 10}),
    "slam.mending.faults.min_backwards": Case(0, "unsigned"),
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
    "self_consistency.torn_jump": Case(
        0.1,
        "itself odometry",
        "figure",
        {"self_consistency.least_detour": 0.5, "self_consistency.least_pairs": 1},
    ),
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
