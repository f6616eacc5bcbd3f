"""Real maps: annotated pairs of two buildings in Halmstad, and the two pieces of Experiment 3."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from scenarios.ablate import peers
from scenarios.ablate.options import HalmstadOptions
from scenarios.jsonable import document
from scenarios.options import parse_names
from scenarios.stages import timed
from slam import se2
from slam.cli import InputError
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from slam.table import Columns, Table, number
from stitch.align import METHODS, AlignConfig, Alternative, NoStitch, Stitch, align
from stitch.alignment.config import TolerantConfig
from stitch.alignment.walls import surfaces
from stitch.command.maps import cropped

RESOLUTION = 0.05
"""Assumed metres to a pixel: the maps do not state it."""
PLAN = "layout"
"""In the name of a floor plan."""
FITS = 2.0
"""Annotations are told apart that no similarity fits this well [m, mean]: some are broken."""
FOUND = (1.0, 2.0)
"""Mean errors of the keypoints [m] below which shares are told; beyond the last an answer is wrong."""
WALL, OPEN = 60, 200
"""Grey levels: at most that of a wall, at least that of free space; what lies between is unknown."""
REACH = 3.0 * RESOLUTION
"""Distance [m] within which a wall of Experiment 3's second piece counts as one of the first."""
HEIGHT, DPI = 7.0, 110
"""Of `comparison_image`: its height [inch] and resolution."""


@dataclass(frozen=True)
class AnnotatedResult:
    """One method on an annotated pair: mean error of the keypoints [m] of its best candidate, accepted or
    not, rigid and bent, and how large it is for half of them; NaN where there is none."""

    method: str
    building: str
    a: str
    b: str
    plan: bool
    fits: bool
    accepted: bool
    error_m: float
    median_m: float
    bent_m: float
    seconds: float
    reason: str

    @property
    def wrong(self) -> bool:
        """Accepted, but further off than what counts as found."""
        return self.accepted and not self.error_m < FOUND[-1]


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
    methods = parse_names(options.methods, [*METHODS, peers.KISS], "method")
    if peers.KISS in methods and not peers.is_installed():
        raise InputError(f"--methods {peers.KISS}: KISS-Matcher is not installed: pip install kiss-matcher")
    halmstad, pieces = options.data / "halmstad", options.data / "maps" / "exp3"
    if not options.data.is_dir():
        raise InputError(f"--data {options.data}: expected a folder with halmstad/ or maps/exp3/")
    pairs = align_annotated(halmstad, methods, options.scale) if halmstad.is_dir() else []
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
    for title, group in groups(pairs):
        pairs_table(title, group).print()
    if shares:
        title = "Experiment 3: share of part2's walls within 3 pixels of part1's"
        Table.of(shares, PIECES_COLUMNS, title, names=4).print()


def groups(results: Sequence[AnnotatedResult]) -> Iterator[tuple[str, list[AnnotatedResult]]]:
    """Titles and results of the tables that are not empty."""
    sensor = [result for result in results if not result.plan]
    told = (
        ("Halmstad, all annotated pairs of maps", sensor),
        ("of these, pairs whose annotations a similarity fits", [one for one in sensor if one.fits]),
        ("Halmstad, maps and floor plans, scale unknown", [one for one in results if one.plan]),
    )
    yield from ((title, group) for title, group in told if group)


@dataclass(frozen=True)
class AnnotatedPair:
    """Two maps, and where the same places are in both: ``keypoints_a (n, 2)`` and ``keypoints_b (n, 2)`` m.

    The similarity that fits them best, ``scale``, misses them by ``residual`` m on the mean.
    """

    a: str
    b: str
    keypoints_a: Array
    keypoints_b: Array
    scale: float
    residual: float

    @property
    def is_plan(self) -> bool:
        """Whether a floor plan is one of the two: always the first."""
        return PLAN in self.a

    def errors(self, T_a_b: Array, scale: float = 1.0) -> Array:
        """How far ``T_a_b (3,)`` puts b's keypoints, first enlarged by ``scale``, from a's ``(n,)`` m."""
        moved = se2.transform(T_a_b, scale * self.keypoints_b)
        distance: Array = np.linalg.norm(moved - self.keypoints_a, axis=1)
        return distance


def annotated_pairs(folder: Path) -> list[AnnotatedPair]:
    """Pairs of a folder's maps with three keypoints or more in common.

    ``<name>.png``, ``keypoints_<name>.npy (n, 2)`` in pixels from the lower left corner, and
    ``association_<a>_<b>.npy (m, 2)``, rows of both. Pickled files are left alone. Floor plans come first.
    """
    keypoints = {
        path.stem: _numbers(folder / f"keypoints_{path.stem}.npy") for path in sorted(folder.glob("*.png"))
    }
    names = sorted(
        (name for name, points in keypoints.items() if points is not None),
        key=lambda name: (PLAN not in name, name),
    )
    pairs = []
    for a, b in combinations(names, 2):
        same = _numbers(folder / f"association_{a}_{b}.npy")
        if same is None or len(same) < 3:
            continue
        rows = same.astype(int)
        pairs.append(_fit(a, b, keypoints[a][rows[:, 0]], keypoints[b][rows[:, 1]]))  # type: ignore[index]
    return pairs


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
    """The pair, and the similarity that moves b's keypoints onto a's."""
    T_a_b = se2.fit_rigid(pixels_b, pixels_a)
    p = (pixels_b - pixels_b.mean(axis=0)) @ se2.rotation(T_a_b[2]).T
    q = pixels_a - pixels_a.mean(axis=0)
    scale = float(np.sum(p * q) / np.sum(p * p))
    residual = float(np.mean(np.linalg.norm(q - scale * p, axis=1))) * RESOLUTION
    return AnnotatedPair(a, b, pixels_a * RESOLUTION, pixels_b * RESOLUTION, scale, residual)


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


def align_annotated(folder: Path, methods: Sequence[str], scale: bool = False) -> list[AnnotatedResult]:
    """Results on all annotated pairs of all buildings in a folder; those with a floor plan with ``scale``."""
    results = []
    for building in sorted(path for path in folder.iterdir() if path.is_dir()):
        pairs = [pair for pair in annotated_pairs(building) if scale or not pair.is_plan]
        names = {name for pair in pairs for name in (pair.a, pair.b)}
        maps = {name: read_map(building / f"{name}.png", walls_only=PLAN in name) for name in sorted(names)}
        for method in methods:
            for pair in pairs:
                ask = peers.align_kiss if method == peers.KISS else align
                config = settings("joint" if method == peers.KISS else method, pair.is_plan)
                result, seconds = timed(ask, maps[pair.a], maps[pair.b], None, config)
                results.append(score(building.name, method, pair, result, seconds))
    return results


def settings(method: str, scale: bool = False) -> AlignConfig:
    """The settings of a method for maps that may be bent, and of which one may have a wrong ``scale``."""
    return AlignConfig(method=method, tolerant=TolerantConfig(enabled=True, free_scale=scale))


def score(
    building: str, method: str, pair: AnnotatedPair, result: Stitch | NoStitch, seconds: float
) -> AnnotatedResult:
    """The errors of the best candidate of an annotated pair."""
    best: Stitch | Alternative | None = result.best if isinstance(result, NoStitch) else result
    rigid = bent = np.full(1, np.nan)
    if best is not None:
        rigid = bent = pair.errors(best.T_a_b, best.scale)
        if best.bend is not None:
            places = best.bend.apply(best.scale * pair.keypoints_b)
            bent = np.linalg.norm(places - pair.keypoints_a, axis=1)
    reason = result.reason if isinstance(result, NoStitch) else ""
    about = method, building, pair.a, pair.b, pair.is_plan, pair.residual < FITS, not reason
    errors = float(np.mean(rigid)), float(np.median(rigid)), float(np.mean(bent))
    return AnnotatedResult(*about, *errors, seconds, reason)


def align_pieces(folder: Path, methods: Sequence[str]) -> list[tuple[PiecesResult, Array | None]]:
    """Results on the two pieces, each with the second's pose ``(3,)`` in the first, if it has a candidate."""
    a, b = read_pieces(folder)
    results = []
    for method in methods:
        ask = peers.align_kiss if method == peers.KISS else align
        config = settings("joint" if method == peers.KISS else method)
        result, seconds = timed(ask, a, b, None, config)
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


def pairs_table(title: str, results: Sequence[AnnotatedResult]) -> Table:
    """A row per method on some annotated pairs."""
    rows = []
    for method in dict.fromkeys(result.method for result in results):
        own = [result for result in results if result.method == method]
        rigid, bent = (np.array([getattr(one, name) for one in own]) for name in ("error_m", "bent_m"))
        shares = [number(float(np.mean(rigid < limit)), 3) for limit in FOUND]
        middle = number(float(np.median(np.nan_to_num(rigid, nan=np.inf))), 2)
        accepted, wrong = sum(one.accepted for one in own), sum(one.wrong for one in own)
        by_half = sum(one.accepted and not one.median_m < FOUND[-1] for one in own)
        seconds = number(float(np.median([result.seconds for result in own])), 2)
        about = *shares, middle, number(float(np.mean(bent < FOUND[0])), 3), str(accepted)
        rows.append((method, str(len(own)), *about, str(wrong), str(by_half), seconds))
    columns = ("method", "pairs", "< 1 m", "< 2 m", "median m", "bent < 1 m", "accepted")
    return Table((*columns, "wrong (mean)", "wrong (median)", "median s"), rows, title)
