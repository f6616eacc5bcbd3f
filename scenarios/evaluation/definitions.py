"""What every metric means, in which unit, which direction is better, and what it cannot see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Definition:
    """Unit, direction, meaning and blind spot of a metric."""

    unit: str
    better: Literal["lower", "higher"] | None
    meaning: str
    cannot_see: str


_ALIGNED = "A bent map: the alignment spreads an error made at one place over the whole drive."
_MEDIAN = "The worse half of the drive."
_TAIL = "Where the error happened, and how most of the drive fared: one bad place rules it."
_ANCHORED = "How good the map is apart from its first heading: a small yaw error there grows with distance."
_LOCAL = (
    "Whether the map closes: errors beyond the window do not count, nor do windows where the robot stood."
)
_RELATION = "Walls and free space; a relation is judged by poses carried between scans by dead reckoning."
_CLEAR = "The same, and the relations it leaves out: those come from stretches where the log is densest."
_MAP = "Which way the map is bent, what no beam ever hit, and walls drawn twice within a cell."
_CHANCE = "Chance: poses of one drive share their errors, so only many drives make a test of it."
_CUTS = "Whether the cuts are where the errors are."
_STITCH = "Good stitches that were never tried; a stitch is judged at the first scans of its two segments."
_JUMP = "How far a pose that was given early jumped when a loop closed later."
_LATENCY = "How long a scan waits for those before it when these take longer than the next one needs to come."
_MEMORY = "What was already in memory before the method began."
_COST = "Other programs running on the same machine, and compilation on a first run."


def _relation_definitions() -> dict[str, Definition]:
    parts = {
        "trans_mean": ("m", "translation error of the relations, mean"),
        "trans_std": ("m", "translation error of the relations, standard deviation"),
        "rot_mean": ("deg", "rotation error of the relations, mean"),
        "rot_std": ("deg", "rotation error of the relations, standard deviation"),
    }
    everything = {f"relation_{k}": Definition(u, "lower", m, _RELATION) for k, (u, m) in parts.items()}
    clear = {
        f"relation_clear_{k}": Definition(u, "lower", f"{m}, unambiguous stamps only", _CLEAR)
        for k, (u, m) in parts.items()
    }
    return everything | clear


def _rpe_definitions() -> dict[str, Definition]:
    return {
        f"rpe_{part}_{length}m": Definition(
            unit, "lower", f"{word} error over {length} m of driving, RMSE", _LOCAL
        )
        for length in (1, 10)
        for part, unit, word in (("trans", "m", "translation"), ("rot", "deg", "rotation"))
    }


DEFINITIONS: dict[str, Definition] = {
    "ate_rmse": Definition("m", "lower", "position error after SE(2) alignment, RMSE", _ALIGNED),
    "ate_median": Definition("m", "lower", "position error after SE(2) alignment, median", _MEDIAN),
    "ate_max": Definition("m", "lower", "position error after SE(2) alignment, largest", _TAIL),
    "ate_rmse_anchored": Definition(
        "m", "lower", "position error in the frame of the first pose, RMSE", _ANCHORED
    ),
    "yaw_rmse": Definition("deg", "lower", "heading error after the same alignment, RMSE", _ALIGNED),
    **_rpe_definitions(),
    **_relation_definitions(),
    "map_f1": Definition("", "higher", "occupied cells against the true map's, one cell of tolerance", _MAP),
    "map_iou": Definition("", "higher", "overlap of the occupied cells, both widened by a cell", _MAP),
    "map_chamfer": Definition("m", "lower", "mean distance between the walls of both maps, both ways", _MAP),
    "anees": Definition("", None, "squared error over its stated covariance, / 3; 1 is honest", _CHANCE),
    "segments": Definition("", None, "pieces the drive was cut into", _CUTS),
    "stitches_tried": Definition("", None, "pairs of pieces that were tried", _STITCH),
    "stitches_accepted": Definition("", None, "stitches the final map rests on", _STITCH),
    "stitches_false": Definition("", "lower", "accepted and off by more than 0.3 m or 2°", _STITCH),
    "ate_online": Definition(
        "m",
        "lower",
        "position error after SE(2) alignment of each pose as given when its scan arrived, RMSE",
        _JUMP,
    ),
    "latency_median": Definition("ms", "lower", "from a scan's arrival to its pose, median", _LATENCY),
    "latency_p99": Definition("ms", "lower", "from a scan's arrival to its pose, 99th percentile", _LATENCY),
    "latency_max": Definition("ms", "lower", "from a scan's arrival to its pose, longest", _LATENCY),
    "wall_s": Definition("s", "lower", "wall time", _COST),
    "scans_per_s": Definition("1/s", "higher", "scans per second of wall time", _COST),
    "peak_mb": Definition("MB", "lower", "peak memory", _MEMORY),
}
"""Metric name -> definition, in the order of the table."""
