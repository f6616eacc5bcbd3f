"""Real maps: annotated pairs of two buildings in Halmstad, and the two pieces of Experiment 3."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from scenarios.jsonable import jsonable
from scenarios.options import parse_names
from slam.cli import InputError
from slam.table import Table, number, with_interval

if TYPE_CHECKING:
    from slam.se2 import Array

LIMIT = (1.0, np.radians(3.0))
"""An alignment of annotated maps is right within this (m at the middle of the keypoints, rad)."""
REACH = 3.0
"""Pixels within which a wall of Experiment 3's second piece counts as one of the first."""
PIECES_RESOLUTION = 0.05
"""Metres to a pixel of Experiment 3's pieces."""
HEIGHT, DPI = 7.0, 110
"""Of `comparison_image`: its height [inch] and resolution."""


@dataclass(frozen=True)
class Options:
    """Align real maps of one building with each other; nothing is tuned on them.

    Halmstad's maps were drawn by a hand-held device and are bent; keypoints were annotated by hand. A pair is
    scored where its keypoints fit a similarity with a scale within 3 % of 1 and a residual under 16 pixels;
    an alignment is right within 1 m and 3° (a pixel taken as 5 cm). Experiment 3 has no truth: what is
    reported is the share of the second piece's walls within 3 pixels of the first's.
    """

    data: Path = Path("../shared/data")
    """The folder with halmstad/ and maps/exp3/."""
    methods: str = "joint,akaze,orb"
    """Methods by name, with commas between."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """A folder for exp3.png: the answers on Experiment 3 beside Formsma's own map."""


@dataclass(frozen=True)
class AnnotatedResult:
    """One method on an annotated pair; NaN errors where it was refused."""

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
class PiecesResult:
    """One method on Experiment 3: the share of walls, of the best candidate where it was refused."""

    method: str
    accepted: bool
    share: float | None
    seconds: float
    reason: str


def run(options: Options) -> None:
    """Every method on every pair, and on the two pieces."""
    from stitch.align import METHODS

    methods = parse_names(options.methods, METHODS, "method")
    halmstad, pieces = options.data / "halmstad", options.data / "maps" / "exp3"
    if not options.data.is_dir():
        raise InputError(f"--data {options.data}: expected a folder with halmstad/ or maps/exp3/")
    pairs = align_annotated(halmstad, methods) if halmstad.is_dir() else []
    placed = align_pieces(pieces, methods) if (pieces / "part1.png").is_file() else []
    shares = [result for result, _ in placed]
    for results, folder in ((pairs, halmstad), (shares, pieces)):
        if not results:
            print(f"skipped: {folder} is absent", file=sys.stderr)
    if options.out is not None and placed:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "exp3.png").write_bytes(comparison_image(pieces, placed))
    if options.format == "json":
        content = {"schema": 1, "study": "halmstad", "pairs": pairs, "exp3": shares}
        print(json.dumps(jsonable(content), indent=2))
        return
    if pairs:
        pairs_table(pairs).print()
    if shares:
        pieces_table(shares).print()


def align_annotated(folder: Path, methods: Sequence[str]) -> list[AnnotatedResult]:
    """Results on all scored pairs of all buildings in a folder."""
    from scenarios.ablate.annotated_maps import annotated_pairs, read_map
    from scenarios.ablate.stitching_trials import score_alignment, timed_align
    from stitch.align import AlignConfig

    results = []
    for building in sorted(path for path in folder.iterdir() if path.is_dir()):
        pairs, annotated = annotated_pairs(building)
        print(f"{building.name}: {len(pairs)} of {annotated} annotated pairs scored", file=sys.stderr)
        maps = {name: read_map(building / f"{name}.png") for pair in pairs for name in (pair.a, pair.b)}
        for method in methods:
            config = AlignConfig(method=method)
            for pair in pairs:
                result, seconds, reason = timed_align(maps[pair.a], maps[pair.b], None, config)
                outcome, error, _ = score_alignment(result, pair.T_a_b, pair.middle_b, LIMIT)
                about = method, building.name, pair.a, pair.b
                results.append(AnnotatedResult(*about, outcome, *error, seconds, reason))
    return results


def align_pieces(folder: Path, methods: Sequence[str]) -> list[tuple[PiecesResult, Array | None]]:
    """Results on the two pieces of Experiment 3, each with the pose ``(3,)`` of the second in the first; None
    without a candidate."""
    from scenarios.ablate.annotated_maps import read_map, shared_walls
    from scenarios.ablate.stitching_trials import timed_align
    from stitch.align import AlignConfig, NoStitch

    a, b = (read_map(folder / f"part{k}.png", PIECES_RESOLUTION, walls_only=True) for k in (1, 2))
    results = []
    for method in methods:
        result, seconds, reason = timed_align(a, b, None, AlignConfig(method=method))
        refused = isinstance(result, NoStitch)
        best = result.best if isinstance(result, NoStitch) else result
        T_a_b = None if best is None else best.T_a_b
        share = None if T_a_b is None else shared_walls(a, b, T_a_b, REACH * PIECES_RESOLUTION)
        results.append((PiecesResult(method, not refused, share, seconds, reason), T_a_b))
    return results


def comparison_image(folder: Path, placed: Sequence[tuple[PiecesResult, Array | None]]) -> bytes:
    """PNG of Formsma's own map of Experiment 3 and every result, walls of both pieces in a third colour."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    from scenarios.ablate.annotated_maps import read_map
    from stitch.command.merge import draw

    grids = [read_map(folder / f"part{k}.png", PIECES_RESOLUTION, walls_only=True).grid for k in (1, 2)]
    pictures = [("Formsma's own", (folder / "full.png").read_bytes())]
    for result, T_a_b in placed:
        if T_a_b is not None:
            verdict = "accepted" if result.accepted else "its best candidate, refused"
            picture = draw(("part 1", "part 2"), grids, [np.zeros(3), T_a_b], 2.0 * PIECES_RESOLUTION)
            pictures.append((f"{result.method}: {result.share:.2f} of part 2's walls, {verdict}", picture))
    images = [imread(io.BytesIO(png), format="png") for _, png in pictures]
    widths = [image.shape[1] / image.shape[0] for image in images]
    figure = Figure(figsize=(HEIGHT * sum(widths), HEIGHT + 0.5), layout="constrained")
    axes = figure.subplots(1, len(images), width_ratios=widths, squeeze=False)[0]
    for ax, image, (title, _) in zip(axes, images, pictures, strict=True):
        ax.imshow(image, cmap="gray", aspect="equal")
        ax.set_title(title, fontsize=11, parse_math=False, wrap=True)
        ax.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, facecolor="white")
    return buffer.getvalue()


def pairs_table(results: Sequence[AnnotatedResult]) -> Table:
    """A row per method on the annotated pairs."""
    from scenarios.ablate.statistics import Proportion
    from scenarios.ablate.stitching_summary import count_outcomes

    rows = []
    for method in dict.fromkeys(result.method for result in results):
        own = [result for result in results if result.method == method]
        right, false, refused = count_outcomes(result.outcome for result in own)
        share = Proportion(right, len(own))
        interval = with_interval(share.value, *share.interval)
        seconds = number(float(np.median([result.seconds for result in own])), 2)
        rows.append((method, str(len(own)), interval, f"{false}/{right + false}", str(refused), seconds))
    columns = ("method", "pairs", "right", "false of accepted", "refused", "median s")
    return Table(columns, rows, "Halmstad, annotated pairs")


def pieces_table(results: Sequence[PiecesResult]) -> Table:
    """A row per method on Experiment 3."""
    rows = [
        (
            result.method,
            number(result.share, 2),
            "accepted" if result.accepted else f"refused: {result.reason}",
            number(result.seconds, 2),
        )
        for result in results
    ]
    title = "Experiment 3: share of part2's walls within 3 pixels of part1's"
    return Table(("method", "share", "answer", "s"), rows, title, names=4)
