"""The relations metric: how well known relative poses are reproduced (Kümmerle et al. 2009)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scenarios.evaluation.metric import Definition, Values, absent
from slam import se2
from slam.recording import Odometry, Recording, Relations
from slam.se2 import Array

STAMP_TOLERANCE = 0.12
"""A relation's stamp and the odometry record it means may be this far apart [s]."""
CLEAR_WINDOW = 0.010
"""A stamp with a second odometry record this near [s] is ambiguous."""
REVISIT_DISTANCE, REVISIT_PATH = 1.0, 10.0
"""A revisit: poses nearer than this [m] after more driving than that [m]."""
TURN_LENGTH = 0.05
"""Metres of path that a radian of turning counts for, so that a turn on the spot takes its share too.

GMapping's answer on the Intel log scores 0.0447 m with it and 0.0453 m without.
"""

PARTS = {
    "trans_mean": ("m", "translation error of the relations, mean"),
    "trans_std": ("m", "translation error of the relations, standard deviation"),
    "rot_mean": ("deg", "rotation error of the relations, mean"),
    "rot_std": ("deg", "rotation error of the relations, standard deviation"),
}
_BLIND = (
    "Walls and free space; a relation is judged by poses carried between scans by dead reckoning, which "
    "published figures hardly need: they rest on logs of many more scans (Intel's on some 13 000)."
)
_CLEAR = "The same, and the relations it leaves out: those come from stretches where the log is densest."
_AT_SCANS = "The relations it leaves out: all for which a pose has to be carried between scans."
ALL = {f"relation_{part}": Definition(unit, "lower", words, _BLIND) for part, (unit, words) in PARTS.items()}
CLEAR = {
    f"relation_clear_{part}": Definition(unit, "lower", f"{words}, unambiguous stamps only", _CLEAR)
    for part, (unit, words) in PARTS.items()
}
AT_SCANS = {
    f"relation_at_scans_{part}": Definition(unit, "lower", f"{words}, both stamps those of scans", _AT_SCANS)
    for part, (unit, words) in PARTS.items()
}
DEFINITIONS = ALL | CLEAR | AT_SCANS


@dataclass(frozen=True)
class RelativePoses:
    """Relative poses ``T_12 (K, 3)`` between ``rows (K, 2)`` of a list of poses. ``clear (K,)`` is True where
    it is beyond doubt which rows are meant, ``at_scans (K,)`` where both are those of scans."""

    rows: np.ndarray
    T_12: Array
    clear: np.ndarray
    at_scans: np.ndarray


def relations_from_truth(truth: Array) -> RelativePoses:
    """Relations between scans from ``truth (N, 3)``: all consecutive ones, and revisits of places. A revisit
    is a pair within 1 m after more than 10 m of driving; of these every k-th is kept, so that there are no
    more of them than scans."""
    n = len(truth)
    steps = np.stack([np.arange(n - 1), np.arange(1, n)], -1)
    near = cKDTree(truth[:, :2]).query_pairs(REVISIT_DISTANCE, output_type="ndarray").reshape(-1, 2)
    travelled = se2.path_length(truth)
    near = near[travelled[near[:, 1]] - travelled[near[:, 0]] > REVISIT_PATH]
    near = near[np.lexsort((near[:, 1], near[:, 0]))]
    rows = np.concatenate([steps, near[:: -(-len(near) // n) or 1]])
    T_12 = se2.between(truth[rows[:, 0]], truth[rows[:, 1]])
    return RelativePoses(rows, T_12, np.ones(len(rows), dtype=bool), np.ones(len(rows), dtype=bool))


def relations_from_stamps(relations: Relations, odometry: Odometry) -> RelativePoses:
    """Relations between rows of the full-rate ``odometry``, each stamp meaning the record nearest in time.

    Records are compared in the order of their stamps; of records with equal stamps before the relation's the
    last in the file is meant, of those after it the first. Relations with a stamp more than 0.12 s from every
    record are left out. Raises ``ValueError`` when that leaves none.
    """
    order = np.argsort(odometry.time, kind="stable")
    time = odometry.time[order]
    after = np.clip(np.searchsorted(time, relations.stamps), 1, max(len(time) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(time) - 1)
    earlier_is_nearer = np.abs(relations.stamps - time[before]) <= np.abs(time[after] - relations.stamps)
    nearest = np.where(earlier_is_nearer, before, after)
    known = np.all(np.abs(time[nearest] - relations.stamps) <= STAMP_TOLERANCE, axis=1)
    if not np.any(known):
        raise ValueError(
            f"none of the {len(known)} relations has both stamps within {STAMP_TOLERANCE} s of the odometry"
        )
    clear = np.all(_unambiguous(relations.stamps, time), axis=1)
    rows = order[nearest[known]]
    at_scans = np.all(np.isin(rows, odometry.scan_row), axis=1)
    return RelativePoses(rows, relations.T_12[known], clear[known], at_scans)


def _unambiguous(stamps: Array, time: Array) -> np.ndarray:
    """Where no more than one of the sorted ``time (M,)`` lies within `CLEAR_WINDOW` of each stamp."""
    first = np.searchsorted(time, stamps - CLEAR_WINDOW, side="left")
    return np.searchsorted(time, stamps + CLEAR_WINDOW, side="right") - first <= 1


def clear_relations(recording: Recording) -> Relations | None:
    """The recording's own relations, else those of its truth with stamps beyond doubt; None without either.
    Like the benchmark's they are between poses of the laser. A stamp with a second odometry record within 10
    ms is left out (Kümmerle et al. 2009 name poses by their stamps alone)."""
    if recording.relations is not None or recording.truth is None or len(recording) < 2:
        return recording.relations
    truth = se2.compose(recording.truth, recording.laser.T_robot_laser)
    pairs = relations_from_truth(truth)
    stamps = recording.time
    if recording.odometry is not None:
        own = recording.odometry.time[recording.odometry.scan_row] == stamps
        stamps = np.concatenate([recording.odometry.time, stamps[~own]])
    clear = np.all(_unambiguous(recording.time, np.sort(stamps))[pairs.rows], axis=1)
    return Relations(recording.time[pairs.rows[clear]], pairs.T_12[clear]) if np.any(clear) else None


def carry(poses: Array, odometry: Odometry) -> Array:
    """Robot poses ``(M, 3)`` at every odometry record from ``poses (N, 3)`` at the scans.

    The pose of the last scan before a record is carried on by odometry; what is then missing at the next scan
    (a body-frame tangent) is spread along the odometry path between the two. Before the first scan and after
    the last there is odometry alone.
    """
    scan_row, records = odometry.scan_row, np.arange(len(odometry.time))
    last = np.clip(np.searchsorted(scan_row, records, side="right") - 1, 0, None)
    following = np.minimum(last + 1, len(poses) - 1)
    start, stop = scan_row[last], scan_row[following]
    motion = odometry.poses
    predicted = se2.compose(poses[last], se2.between(motion[start], motion[stop]))
    correction = se2.log(se2.between(predicted, poses[following]))
    turned = np.cumsum(np.abs(se2.wrap(np.diff(motion[:, 2], prepend=motion[0, 2]))))
    path = se2.path_length(motion) + TURN_LENGTH * turned
    span = path[stop] - path[start]
    share = np.divide(path - path[start], span, out=np.zeros(len(span)), where=span > 0.0)
    carried = se2.compose(poses[last], se2.between(motion[start], motion))
    return se2.compose(carried, se2.exp(np.clip(share, 0.0, 1.0)[:, None] * correction))


def relation_pairs(recording: Recording) -> RelativePoses | None:
    """The relations to score a recording's methods against: its file's, else its truth's, else None."""
    if recording.relations is not None:
        return relations_from_stamps(recording.relations, _odometry(recording))
    if recording.truth is not None and len(recording) > 1:
        return relations_from_truth(recording.truth)
    return None


def relation_metrics(poses: Array, recording: Recording, pairs: RelativePoses | None) -> Values:
    """Mean and standard deviation of the errors of ``poses (N, 3)`` over all and over the clear relations.
    Relations of a file are between poses of the laser: they were made by aligning its scans by hand (Kümmerle
    et al. 2009). Those from truth are between the robot's."""
    if pairs is None:
        return absent(DEFINITIONS, "the recording has neither relations nor truth of two scans")
    at_rows = poses
    if recording.relations is not None:
        at_rows = se2.compose(carry(poses, _odometry(recording)), recording.laser.T_robot_laser)
    error = se2.between(pairs.T_12, se2.between(at_rows[pairs.rows[:, 0]], at_rows[pairs.rows[:, 1]]))
    translation, rotation = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(se2.wrap(error[:, 2])))
    values = _summary(ALL, translation, rotation)
    if recording.relations is None:
        values |= absent(CLEAR, "relations made from truth have no ambiguous stamps")
        return values | absent(AT_SCANS, "relations made from truth are all between scans")
    for names, chosen, why in (
        (CLEAR, pairs.clear, "every relation has an ambiguous stamp"),
        (AT_SCANS, pairs.at_scans, "no relation has both stamps at scans"),
    ):
        some = np.any(chosen)
        values |= _summary(names, translation[chosen], rotation[chosen]) if some else absent(names, why)
    return values


def _summary(names: Iterable[str], translation: Array, rotation: Array) -> Values:
    numbers = translation.mean(), translation.std(), rotation.mean(), rotation.std()
    return dict(zip(names, numbers, strict=True))


def _odometry(recording: Recording) -> Odometry:
    if recording.odometry is not None:
        return recording.odometry
    return Odometry(recording.time, recording.dead_reckoning, np.arange(len(recording)))
