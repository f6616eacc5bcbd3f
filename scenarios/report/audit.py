"""The logs of the thesis: its correlations made again, and its measures scored against the truth in them.

The thesis (Formsma 2012) correlates trace, determinant and number of matches over all patches of its
Experiment 1. Its covariances are the 2×2 position block in mm², of which it takes magnitudes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.evaluation.detection import Decision, average_precision, decided, roc_auc, spearman
from slam import se2
from slam.cli import InputError
from slam.odometry.confidence import step_error
from slam.se2 import Array
from slam.table import Table, number

FILE = "wsm_patches.json"
PRINTED = {"trace and det": 0.85, "matches and det": -0.50, "matches and trace": -0.48}
"""Rank correlations as the thesis prints them."""


@dataclass(frozen=True)
class Patches:
    """N published patches: ``covariance (N, 3, 3)`` in mm and rad, NaN where nothing matched; ``matches
    (N,)``; ``extends (N,)`` bool, those that became part of the map; ``slam (N, 3)`` and ``truth (N, 3)``
    in m and rad."""

    covariance: Array
    matches: Array
    extends: np.ndarray
    slam: Array
    truth: Array


@dataclass(frozen=True)
class Audit:
    """Correlations by pair of measures with failed matches as zero variance and as lost; and over the
    ``steps`` between extending patches, of which ``lost`` were, the decision to call those without a match
    and of each measure the area under the ROC curve and the average precision, over all steps and over those
    with a match."""

    as_zero: dict[str, float]
    as_lost: dict[str, float]
    unmatched: int
    steps: int
    lost: int
    zero_rule: Decision
    scores: dict[str, list[float]]

    @property
    def labels_swapped(self) -> bool | None:
        """Whether the two printed correlations of the matches fit each other's labels better than their own;
        None where this is not the log that was printed."""
        trace_det, *own = [abs(self.as_zero[pair] - value) for pair, value in PRINTED.items()]
        swapped = abs(self.as_zero["matches and det"] - PRINTED["matches and trace"])
        swapped += abs(self.as_zero["matches and trace"] - PRINTED["matches and det"])
        if trace_det > 0.01 or min(sum(own), swapped) > 0.01:
            return None
        return swapped < sum(own)


def run(folders: Sequence[Path], out: Path | None) -> str:
    """The audit of each folder's log as text; into the file ``out`` as well. Raises `InputError`."""
    text = "\n\n".join(f"{folder}\n{to_text(audit(read(folder / FILE)))}" for folder in folders)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
    return text


def read(path: Path) -> Patches:
    """Published patches; the file is a list without its brackets. Raises `InputError`."""
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected the patches that the thesis published")
    try:
        records = json.loads("[" + path.read_text(encoding="utf-8").strip().rstrip(",") + "]")
        return Patches(
            np.reshape([record["covariance"] for record in records], (-1, 3, 3)).astype(float),
            np.array([record["matches"] for record in records], dtype=float),
            np.array([record["extend"] for record in records], dtype=bool),
            _poses(records, "slam"),
            _poses(records, "groundtruth"),
        )
    except KeyError as error:
        raise InputError(f"{path}: expected patches with {error}") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: expected a list of patches without brackets: {error}") from error


def audit(patches: Patches) -> Audit:
    """The numbers of the thesis made again, and what the truth says. Raises `InputError` where no step or
    every step is lost."""
    failed = np.isnan(patches.covariance[:, 0, 0]) | (patches.matches == 0)
    badness = _badness(patches, failed)
    steps = np.flatnonzero(patches.extends)
    before, after = steps[:-1], steps[1:]
    truth, slam = (se2.between(poses[before], poses[after]) for poses in (patches.truth, patches.slam))
    error = se2.between(truth, slam)
    lost, zero = step_error(error) > 1.0, failed[after]
    if not lost.any() or lost.all():
        raise InputError(f"{lost.sum()} of {len(lost)} steps are lost: nothing to tell apart")
    return Audit(
        as_zero=_correlations({name: np.where(failed, 0.0, values) for name, values in badness.items()}),
        as_lost=_correlations({**badness, "matches": np.where(failed, 0.0, badness["matches"])}),
        unmatched=int(failed.sum()),
        steps=len(lost),
        lost=int(lost.sum()),
        zero_rule=decided(zero, lost),
        scores={
            name: [
                measure(values[after][steps], lost[steps])
                for steps in (np.full(len(lost), True), ~zero)
                for measure in (roc_auc, average_precision)
            ]
            for name, values in badness.items()
        },
    )


def to_text(result: Audit) -> str:
    """An audit as tables and sentences."""
    swapped, rule = result.labels_swapped, result.zero_rule
    about = (
        "These are not the patches whose correlations the thesis prints."
        if swapped is None
        else f"Made again with the {result.unmatched} patches without a match as zero variance, which turns "
        "them into the most certain ones; as lost they are the least certain."
    )
    labels = ["The last two printed numbers fit when interchanged: the thesis swaps their labels."]
    correlations = Table(
        ["rank correlation of", "printed", "made again", "as lost"],
        [
            [pair, number(printed, 2), number(result.as_zero[pair]), number(result.as_lost[pair])]
            for pair, printed in PRINTED.items()
        ],
        notes=["", *(labels if swapped else []), about],
    )
    scores = Table(
        ["measure", "AUC", "AP", "AUC, steps with a match", "AP, steps with a match"],
        [
            *([name, *map(number, scores)] for name, scores in result.scores.items()),
            ["chance", number(0.5), number(result.lost / result.steps), "", ""],
        ],
    )
    sentences = (
        f"{result.lost} of {result.steps} steps between extending patches are off by more than 0.2 m or 5°.\n"
        f"Cutting where nothing matched finds {rule.right} of them (recall {rule.recall:.2f}, "
        f"precision {rule.precision:.2f})."
    )
    return "\n\n".join([correlations.console(), sentences, scores.console()])


def _badness(patches: Patches, failed: np.ndarray) -> dict[str, Array]:
    """The three measures ``(N,)``, larger = worse; +inf where nothing matched."""
    P = patches.covariance
    values = {
        "trace": np.abs(P[:, 0, 0] + P[:, 1, 1]),
        "det": np.abs(P[:, 0, 0] * P[:, 1, 1] - P[:, 0, 1] * P[:, 1, 0]),
        "matches": -patches.matches,
    }
    return {name: np.where(failed, np.inf, value) for name, value in values.items()}


def _correlations(badness: dict[str, Array]) -> dict[str, float]:
    """Rank correlations of the three, of the matches themselves rather than of their lack."""
    columns = {**badness, "matches": -badness["matches"]}
    return {pair: spearman(*(columns[name] for name in pair.split(" and "))) for pair in PRINTED}


def _poses(records: Sequence[dict[str, dict[str, float]]], name: str) -> Array:
    """Poses ``(N, 3)`` [m, rad] of records in mm; their handedness does not matter to an error."""
    poses = np.array([[record[name][axis] for axis in ("x", "y", "yaw")] for record in records], dtype=float)
    return poses * [1e-3, 1e-3, 1.0]
