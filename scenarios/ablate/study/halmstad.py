"""Real maps: annotated pairs of two buildings in Halmstad, and the two pieces of Experiment 3."""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from scenarios.ablate.study.stitching import chosen
from slam.cli import InputError

if TYPE_CHECKING:
    from slam.se2 import Array

METHODS = "joint,akaze,orb"
LIMIT = (1.0, 3.0)
"""A stitch of annotated maps is right within this (m at the middle of the keypoints, degrees)."""
REACH = 3.0
"""Pixels within which a wall of Experiment 3's second piece counts as one of the first."""
PIECES_RESOLUTION = 0.05


@dataclass(frozen=True)
class Options:
    """Align real maps of one building with each other; nothing is tuned on them.

    Halmstad's maps were drawn by a hand-held device and are bent; keypoints were annotated by hand. A pair is
    scored where its keypoints fit a similarity with a scale within 3 % of 1 and a residual under 16 pixels; a
    stitch is right within 1 m and 3° (a pixel taken as 5 cm). Experiment 3 has no truth: what is reported is
    the share of the second piece's walls within 3 pixels of the first's.
    """

    data: Path = Path("../shared/data")
    """The folder with halmstad/ and maps/exp3/."""
    methods: str = METHODS
    """Methods by name, with commas between."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """A folder for exp3.png: the answers on Experiment 3 beside the report's own map."""


@dataclass(frozen=True)
class RealRow:
    """One answer on an annotated pair; NaN errors where it was refused."""

    method: str
    building: str
    a: str
    b: str
    outcome: str
    error_m: float
    error_deg: float
    seconds: float
    reason: str


@dataclass(frozen=True)
class PieceRow:
    """One answer on Experiment 3: the share of walls, of the best candidate where it was refused."""

    method: str
    accepted: bool
    share: float | None
    seconds: float
    reason: str


def run(options: Options) -> None:
    """Every method on every pair, and on the two pieces."""
    from stitch.align import METHODS as KNOWN

    methods = chosen(options.methods, list(KNOWN), "method")
    halmstad, pieces = options.data / "halmstad", options.data / "maps" / "exp3"
    if not options.data.is_dir():
        raise InputError(f"--data {options.data}: expected a folder with halmstad/ or maps/exp3/")
    rows = on_pairs(halmstad, methods) if halmstad.is_dir() else []
    answers = on_pieces(pieces, methods) if (pieces / "part1.png").is_file() else []
    shares = [row for row, _ in answers]
    for found, folder in ((rows, halmstad), (shares, pieces)):
        if not found:
            print(f"skipped: {folder} is absent", file=sys.stderr)
    if options.out is not None and answers:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "exp3.png").write_bytes(beside_the_report(pieces, answers))
    if options.format == "json":
        about = {"schema": 1, "study": "halmstad"}
        found_json = {"pairs": [_plain(asdict(row)) for row in rows], "exp3": [asdict(row) for row in shares]}
        print(json.dumps(about | found_json, indent=2))
        return
    print_rows(rows, shares)


def on_pairs(folder: Path, methods: list[str]) -> list[RealRow]:
    """Rows of all scored pairs of all buildings in a folder."""
    from scenarios.ablate.annotated import annotated_pairs, read_map
    from stitch.align import AlignConfig, NoStitch, align

    rows = []
    for building in sorted(path for path in folder.iterdir() if path.is_dir()):
        pairs, annotated = annotated_pairs(building)
        print(f"{building.name}: {len(pairs)} of {annotated} annotated pairs scored", file=sys.stderr)
        maps = {name: read_map(building / f"{name}.png") for pair in pairs for name in (pair.a, pair.b)}
        for method in methods:
            config = AlignConfig(method=method)
            for pair in pairs:
                started = time.process_time()
                answer = align(maps[pair.a], maps[pair.b], None, config)
                seconds = time.process_time() - started
                reason = answer.reason if isinstance(answer, NoStitch) else ""
                outcome, error = judged(answer, pair.T_a_b, pair.middle_b)
                rows.append(RealRow(method, building.name, pair.a, pair.b, outcome, *error, seconds, reason))
    return rows


def judged(answer: object, T_a_b: np.ndarray, middle_b: np.ndarray) -> tuple[str, tuple[float, float]]:
    """Outcome and error (m at b's point ``middle_b (2,)``, degrees) of an answer."""
    from slam import se2
    from stitch.align import Stitch

    if not isinstance(answer, Stitch):
        return "refused", (np.nan, np.nan)
    apart = se2.transform(answer.T_a_b, middle_b[None]) - se2.transform(T_a_b, middle_b[None])
    distance = float(np.linalg.norm(apart))
    angle = float(np.degrees(abs(se2.wrap(answer.T_a_b[2] - T_a_b[2]))))
    return ("right" if distance <= LIMIT[0] and angle <= LIMIT[1] else "false"), (distance, angle)


def on_pieces(folder: Path, methods: list[str]) -> list[tuple[PieceRow, Array | None]]:
    """Rows of the two pieces of Experiment 3, each with where the second lies in the first ``(3,)``, if the
    method has any idea."""
    from scenarios.ablate.annotated import read_map, shared_walls
    from stitch.align import AlignConfig, NoStitch, align

    a, b = (read_map(folder / f"part{k}.png", PIECES_RESOLUTION, walls_only=True) for k in (1, 2))
    rows = []
    for method in methods:
        started = time.process_time()
        answer = align(a, b, None, AlignConfig(method=method))
        seconds = time.process_time() - started
        refused = isinstance(answer, NoStitch)
        best = answer.best if isinstance(answer, NoStitch) else answer
        share = None if best is None else shared_walls(a, b, best.T_a_b, REACH * PIECES_RESOLUTION)
        reason = answer.reason if isinstance(answer, NoStitch) else ""
        row = PieceRow(method, not refused, share, seconds, reason)
        rows.append((row, None if best is None else best.T_a_b))
    return rows


def beside_the_report(folder: Path, answers: list[tuple[PieceRow, Array | None]]) -> bytes:
    """PNG of every answer on Experiment 3, walls of both pieces in a third colour, after the report's own."""
    from scenarios.ablate.annotated import read_map
    from scenarios.ablate.beside import row
    from stitch.command.picture import draw

    grids = [read_map(folder / f"part{k}.png", PIECES_RESOLUTION, walls_only=True).grid for k in (1, 2)]
    pictures = [("the report's own", (folder / "full.png").read_bytes())]
    for piece, T_a_b in answers:
        if T_a_b is not None:
            told = "accepted" if piece.accepted else "its best candidate, refused"
            picture = draw(("part 1", "part 2"), grids, [np.zeros(3), T_a_b], 2.0 * PIECES_RESOLUTION)
            pictures.append((f"{piece.method}: {piece.share:.2f} of part 2's walls, {told}", picture))
    return row(pictures)


def print_rows(rows: list[RealRow], shares: list[PieceRow]) -> None:
    """Both tables on stdout."""
    import rich.box
    from rich.console import Console
    from rich.table import Table

    from scenarios.ablate.summary import Share

    console = Console(width=max(120, Console().width), highlight=False)
    if rows:
        table = Table(title="Halmstad, annotated pairs", box=rich.box.SIMPLE_HEAD)
        for column in ("method", "pairs", "right", "false of accepted", "refused", "median s"):
            table.add_column(column, no_wrap=True, justify="left" if column == "method" else "right")
        by_method: dict[str, list[RealRow]] = defaultdict(list)
        for row in rows:
            by_method[row.method].append(row)
        for method, own in by_method.items():
            counts = {o: sum(row.outcome == o for row in own) for o in ("right", "false", "refused")}
            low, high = Share(counts["right"], len(own)).interval
            table.add_row(
                method,
                str(len(own)),
                f"{counts['right'] / len(own):.2f} [{low:.2f}, {high:.2f}]",
                f"{counts['false']}/{counts['right'] + counts['false']}",
                str(counts["refused"]),
                f"{np.median([row.seconds for row in own]):.2f}",
            )
        console.print(table)
    if shares:
        table = Table(
            title="Experiment 3: share of part2's walls within 3 pixels of part1's", box=rich.box.SIMPLE_HEAD
        )
        for column in ("method", "share", "answer", "s"):
            table.add_column(column, no_wrap=True)
        for piece in shares:
            share = "–" if piece.share is None else f"{piece.share:.2f}"
            said = "accepted" if piece.accepted else f"refused: {piece.reason}"
            table.add_row(piece.method, share, said, f"{piece.seconds:.2f}")
        console.print(table)


def _plain(row: dict[str, object]) -> dict[str, object]:
    return {
        name: None if isinstance(value, float) and np.isnan(value) else value for name, value in row.items()
    }
