"""Real maps: annotated pairs of two buildings in Halmstad, and the two pieces of Experiment 3."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from scenarios.ablate.options import HalmstadOptions
from scenarios.ablate.study.stitching import count_outcomes, score_alignment
from scenarios.jsonable import document
from scenarios.options import parse_names
from scenarios.stages import timed
from slam import se2
from slam.cli import InputError
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from slam.table import Columns, Table, number
from stitch.align import METHODS, AlignConfig, NoStitch, align
from stitch.alignment.walls import surfaces
from stitch.command.maps import cropped

RESOLUTION = 0.05
"""Assumed metres to a pixel: the maps do not state it."""
MOST_SCALE, MOST_RESIDUAL = 0.03, 16.0
"""A pair is scored whose fitted scale differs from 1 by less and whose residual is less (pixels, rms)."""
WALL, OPEN = 60, 200
"""Grey levels: at most that of a wall, at least that of free space; what lies between is unknown."""
LIMIT = (1.0, np.radians(3.0))
"""An alignment of annotated maps is right within this (m at the middle of the keypoints, rad)."""
REACH = 3.0 * RESOLUTION
"""Distance [m] within which a wall of Experiment 3's second piece counts as one of the first."""
HEIGHT, DPI = 7.0, 110
"""Of `comparison_image`: its height [inch] and resolution."""


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


PIECES_COLUMNS: Columns = (
    ("method", lambda one: one.method),
    ("share", lambda one: number(one.share, 2)),
    ("answer", lambda one: "accepted" if one.accepted else f"refused: {one.reason}"),
    ("s", lambda one: number(one.seconds, 2)),
)


def run(options: HalmstadOptions) -> None:
    """Every method on every pair, and on the two pieces."""
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
        print(document(study="halmstad", pairs=pairs, exp3=shares))
        return
    if pairs:
        pairs_table(pairs).print()
    if shares:
        title = "Experiment 3: share of part2's walls within 3 pixels of part1's"
        Table.of(shares, PIECES_COLUMNS, title, names=4).print()


@dataclass(frozen=True)
class AnnotatedPair:
    """Two maps and the rigid ``T_a_b (3,)`` m that their annotations fit best; ``middle_b (2,)`` m is the
    middle of b's keypoints, ``residual`` their rms error in pixels."""

    a: str
    b: str
    T_a_b: Array
    middle_b: Array
    scale: float
    residual: float


def annotated_pairs(folder: Path) -> tuple[list[AnnotatedPair], int]:
    """Pairs of a folder's maps that can be scored, and how many were annotated.

    ``<name>.png``, ``keypoints_<name>.npy (n, 2)`` in pixels from the lower left corner, and
    ``association_<a>_<b>.npy (m, 2)``, rows of both. Pickled files are left alone.
    """
    keypoints = {
        path.stem: _numbers(folder / f"keypoints_{path.stem}.npy") for path in sorted(folder.glob("*.png"))
    }
    names = [name for name, points in keypoints.items() if points is not None and "layout" not in name]
    pairs, annotated = [], 0
    for a, b in combinations(names, 2):
        same = _numbers(folder / f"association_{a}_{b}.npy")
        if same is None or len(same) < 3:
            continue
        annotated += 1
        rows = same.astype(int)
        pair = _fit(a, b, keypoints[a][rows[:, 0]], keypoints[b][rows[:, 1]])  # type: ignore[index]
        if abs(pair.scale - 1.0) <= MOST_SCALE and pair.residual < MOST_RESIDUAL:
            pairs.append(pair)
    return pairs, annotated


def _numbers(path: Path) -> Array | None:
    """An array of numbers with two columns; None where there is none (a pickled object is never loaded)."""
    if not path.is_file():
        return None
    try:
        array = np.load(path, allow_pickle=False)
    except ValueError:
        return None
    return array if array.ndim == 2 and array.shape[1] == 2 else None


def _fit(a: str, b: str, pixels_a: Array, pixels_b: Array) -> AnnotatedPair:
    """The similarity that moves b's keypoints onto a's; its scale is not part of ``T_a_b``."""
    T_a_b = se2.fit_rigid(pixels_b, pixels_a)
    p = (pixels_b - pixels_b.mean(axis=0)) @ se2.rotation(T_a_b[2]).T
    q = pixels_a - pixels_a.mean(axis=0)
    scale = float(np.sum(p * q) / np.sum(p * p))
    residual = float(np.sqrt(np.mean(np.sum((q - scale * p) ** 2, axis=1))))
    T_a_b[:2] *= RESOLUTION
    return AnnotatedPair(a, b, T_a_b, pixels_b.mean(axis=0) * RESOLUTION, scale, residual)


def read_map(path: Path, resolution: float = RESOLUTION, walls_only: bool = False) -> Submap:
    """A picture as a submap, its frame in the lower left corner; white is unknown where it shows
    ``walls_only``. Raises `InputError` for what is no picture."""
    import cv2

    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise InputError(f"{path}: expected a picture")
    grey = np.ascontiguousarray(grey[::-1])
    free = np.zeros(grey.shape, dtype=bool) if walls_only else grey >= OPEN
    grid = cropped(Grid(grey <= WALL, free, np.zeros(2), resolution))
    return Submap(0, 1, np.zeros(3), surfaces(grid), grid)


def read_pieces(folder: Path) -> list[Submap]:
    """The two pieces of Experiment 3."""
    return [read_map(folder / f"part{k}.png", walls_only=True) for k in (1, 2)]


def shared_walls(a: Submap, b: Submap, T_a_b: Array, reach: float) -> float:
    """Share of b's occupied cells that lie within ``reach`` m of one of a's once moved by ``T_a_b (3,)``."""
    moved = se2.transform(T_a_b, b.grid.occupied_points())
    distance, _ = cKDTree(a.grid.occupied_points()).query(moved)
    return float(np.mean(distance <= reach))


def align_annotated(folder: Path, methods: Sequence[str]) -> list[AnnotatedResult]:
    """Results on all scored pairs of all buildings in a folder."""
    results = []
    for building in sorted(path for path in folder.iterdir() if path.is_dir()):
        pairs, annotated = annotated_pairs(building)
        print(f"{building.name}: {len(pairs)} of {annotated} annotated pairs scored", file=sys.stderr)
        maps = {name: read_map(building / f"{name}.png") for pair in pairs for name in (pair.a, pair.b)}
        for method in methods:
            for pair in pairs:
                result, seconds = timed(align, maps[pair.a], maps[pair.b], None, AlignConfig(method=method))
                outcome, error, _ = score_alignment(result, pair.T_a_b, pair.middle_b, LIMIT)
                about = method, building.name, pair.a, pair.b
                reason = result.reason if isinstance(result, NoStitch) else ""
                results.append(AnnotatedResult(*about, outcome, *error, seconds, reason))
    return results


def align_pieces(folder: Path, methods: Sequence[str]) -> list[tuple[PiecesResult, Array | None]]:
    """Results on the two pieces, each with the second's pose ``(3,)`` in the first, if it has a candidate."""
    a, b = read_pieces(folder)
    results = []
    for method in methods:
        result, seconds = timed(align, a, b, None, AlignConfig(method=method))
        refused = isinstance(result, NoStitch)
        best, reason = (result.best, result.reason) if isinstance(result, NoStitch) else (result, "")
        share = None if best is None else shared_walls(a, b, best.T_a_b, REACH)
        pose = None if best is None else best.T_a_b
        results.append((PiecesResult(method, not refused, share, seconds, reason), pose))
    return results


def comparison_image(folder: Path, placed: Sequence[tuple[PiecesResult, Array | None]]) -> bytes:
    """PNG of Formsma's own map of Experiment 3 and every result, walls of both pieces in a third colour."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    from scenarios.report.style import png
    from stitch.command.merge import draw

    grids = [piece.grid for piece in read_pieces(folder)]
    pictures = [("Formsma's own", (folder / "full.png").read_bytes())]
    for result, T_a_b in placed:
        if T_a_b is not None:
            verdict = "accepted" if result.accepted else "its best candidate, refused"
            picture = draw(("part 1", "part 2"), grids, [np.zeros(3), T_a_b], 2.0 * RESOLUTION)
            pictures.append((f"{result.method}: {result.share:.2f} of part 2's walls, {verdict}", picture))
    images = [imread(io.BytesIO(content), format="png") for _, content in pictures]
    widths = [image.shape[1] / image.shape[0] for image in images]
    figure = Figure(figsize=(HEIGHT * sum(widths), HEIGHT + 0.5), layout="constrained")
    axes = figure.subplots(1, len(images), width_ratios=widths, squeeze=False)[0]
    for ax, image, (title, _) in zip(axes, images, pictures, strict=True):
        ax.imshow(image, cmap="gray", aspect="equal")
        ax.set_title(title, fontsize=11, parse_math=False, wrap=True)
        ax.set_axis_off()
    return png(figure, DPI)


def pairs_table(results: Sequence[AnnotatedResult]) -> Table:
    """A row per method on the annotated pairs."""
    rows = []
    for method in dict.fromkeys(result.method for result in results):
        own = [result for result in results if result.method == method]
        accepted, right, false, refused = count_outcomes([result.outcome for result in own])
        seconds = number(float(np.median([result.seconds for result in own])), 2)
        false_of = f"{false.count}/{accepted}"
        rows.append((method, str(len(own)), str(right), false_of, str(refused.count), seconds))
    columns = ("method", "pairs", "right", "false of accepted", "refused", "median s")
    return Table(columns, rows, "Halmstad, annotated pairs")
