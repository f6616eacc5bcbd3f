"""Submissions as the rows of a table."""

from __future__ import annotations

from collections.abc import Sequence

from scenarios.suite.row import FAILED, JUDGE, UNANSWERED, Row
from scenarios.suite.significance import mean_ranks
from scenarios.suite.version import suite
from slam.table import ABSENT, Bold, Cell, Table, number

COLUMNS = (
    "submission", "mean rank", "scored", "failed", "not answered", "ATE mean m", "ATE worst m", "worst on",
    "yaw °", "relations m", "map F1", "anees_k", "CRPS m", "wall s",
)  # fmt: skip
NOTE = (
    "mean rank: by ATE on each recording, a failure last; means, medians (anees_k) and worst are of what was "
    "scored: compare them only between rows without failures"
)


def table(rows: Sequence[Row]) -> Table:
    """A row for each submission, the best mean rank first."""
    names = list(dict.fromkeys(name for row in rows for name in row.results))
    ranks = mean_ranks([row.errors(names) for row in rows])
    order = sorted(range(len(rows)), key=lambda k: (ranks[k], rows[k].name))
    cells = [_cells(rows[k], ranks[k] if len(rows) > 1 else None, first=k == order[0]) for k in order]
    title = f"Suite {suite().name}, {rows[0].split}: {len(names)} recordings"
    return Table(COLUMNS, cells, title, notes=[NOTE])


def _cells(row: Row, rank: float | None, first: bool) -> list[Cell]:
    status = [result.status for result in row.results.values()]
    worst = row.worst()
    judged: Cell = number(row.mean(JUDGE))
    return [
        row.name,
        Bold(number(rank, 2)) if first and rank is not None else number(rank, 2),
        f"{len(status) - row.failures}/{len(status)}",
        str(status.count(FAILED)),
        str(status.count(UNANSWERED)),
        judged,
        ABSENT if worst is None else number(worst[1]),
        ABSENT if worst is None else worst[0],
        number(row.mean("yaw_rmse"), 2),
        number(row.mean("relation_trans_mean"), 4),
        number(row.mean("map_f1")),
        number(row.median("anees_k"), 2),
        number(row.mean("crps_trans"), 4),
        "not stated" if row.wall_s is None else number(row.wall_s, 1),
    ]
