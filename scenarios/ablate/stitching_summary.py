"""Rows of alignments as proportions with intervals, by method and bin, and as a table and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.ablate.statistics import Proportion
from scenarios.ablate.stitching_trials import AlignmentRow
from scenarios.jsonable import jsonable
from slam.table import Table, number, with_interval

ALL = "all"
"""The bin of all bins together."""
COLUMNS = ("method", "overlap", "pairs", "right", "false of accepted", "refused", "ms", "ANEES/3")


@dataclass(frozen=True)
class BinSummary:
    """One method in one bin: proportions of all pairs, but ``false`` of the accepted; median processor time
    in s.

    ``anees`` is that of the right alignments, divided by 3 (a false one is beyond any covariance); NaN where
    none has a covariance.
    """

    variant: str
    bin: str
    right: Proportion
    false: Proportion
    refused: Proportion
    seconds: float
    anees: float


def summarise(rows: Sequence[AlignmentRow], bins: Iterable[str]) -> list[BinSummary]:
    """A summary per method and bin that has pairs, and one over all bins for each method."""
    bins, summaries = list(bins), []
    for variant in dict.fromkeys(row.variant for row in rows):
        own = [row for row in rows if row.variant == variant]
        parts = {name: [row for row in own if row.bin == name] for name in bins} | {ALL: own}
        summaries += [_summary(variant, name, part) for name, part in parts.items() if part]
    return summaries


def _summary(variant: str, name: str, rows: Sequence[AlignmentRow]) -> BinSummary:
    right, false, refused = count_outcomes(row.outcome for row in rows)
    nees = np.array([row.nees for row in rows if row.outcome == "right" and np.isfinite(row.nees)])
    return BinSummary(
        variant,
        name,
        Proportion(right, len(rows)),
        Proportion(false, right + false),
        Proportion(refused, len(rows)),
        seconds=float(np.median([row.seconds for row in rows])),
        anees=float(nees.mean()) / 3.0 if len(nees) else float("nan"),
    )


def count_outcomes(outcomes: Iterable[str]) -> tuple[int, int, int]:
    """How many are right, false and refused."""
    outcomes = list(outcomes)
    return outcomes.count("right"), outcomes.count("false"), outcomes.count("refused")


def summary_table(title: str, summaries: Sequence[BinSummary], notes: Sequence[str]) -> Table:
    """Proportions with their intervals, by method and bin, and the notes below."""
    rows = [
        (
            one.variant,
            one.bin,
            str(one.right.n),
            with_interval(one.right.value, *one.right.interval),
            f"{one.false.count}/{one.false.n}",
            with_interval(one.refused.value, *one.refused.interval),
            f"{1e3 * one.seconds:.0f}",
            number(one.anees, 2),
        )
        for one in summaries
    ]
    return Table(COLUMNS, rows, title, names=2, notes=notes).grouped()


def summaries_json(summaries: Sequence[BinSummary], about: Mapping[str, object]) -> str:
    """The same as one object; a number that does not exist is null."""
    lines = [
        {
            "method": one.variant,
            "bin": one.bin,
            "pairs": one.right.n,
            "accepted": one.false.n,
            **{
                name: {"count": share.count, "share": share.value, "interval": share.interval}
                for name, share in (("right", one.right), ("false", one.false), ("refused", one.refused))
            },
            "median_s": one.seconds,
            "anees": one.anees,
        }
        for one in summaries
    ]
    return json.dumps(jsonable({"schema": 1, **about, "lines": lines}), indent=2)
