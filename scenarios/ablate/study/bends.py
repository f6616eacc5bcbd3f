"""How well a known bend is found, and how often bent maps are joined rightly, wrongly or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scenarios.ablate.options import BendsOptions
from scenarios.ablate.pair_sampling import BINS, SubmapPair, negative_pairs, sample_pairs
from scenarios.ablate.smooth_field import SmoothField, bend_map
from scenarios.ablate.trial_io import stream
from scenarios.catalogue import CATALOGUE
from scenarios.jsonable import document
from scenarios.options import parse_names, parse_seeds
from scenarios.stages import timed
from slam import se2
from slam.cli import InputError
from slam.se2 import Array
from slam.table import Table, number
from stitch.align import AlignConfig, NoStitch, Stitch, align
from stitch.alignment.config import TolerantConfig

CONFIG = AlignConfig(tolerant=TolerantConfig(enabled=True))
FOUND = 1.0
"""An alignment is right whose rigid part misses the shared walls by less on the mean [m]."""
SHARED = 0.4
"""Walls of the bent map are shared that truly lie this near to one of the other [m]."""
PER_BIN = 5
"""Pairs of a bin from one building."""
SAME_PLAN = ("two_drives", "office_smoke")
"""Scenarios of one floor plan: their buildings are no strangers."""


@dataclass(frozen=True)
class BendResult:
    """One pair: mean error [m] of where the shared walls are put, rigid and bent; NaN where nothing is."""

    scenario: str
    seed: int
    bin: str
    amplitude_m: float
    accepted: bool
    was_bent: bool
    rigid_m: float
    bent_m: float
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the best candidate is the true place."""
        return self.rigid_m < FOUND


def run(options: BendsOptions) -> None:
    """Bend the second map of every pair by every amplitude, and join them."""
    scenarios = parse_names(options.scenarios, CATALOGUE, "scenario")
    seeds = parse_seeds(options.seeds)
    if not all(amplitude >= 0.0 for amplitude in options.amplitudes):
        raise InputError(f"--amplitudes: expected metres, 0 or more, got {options.amplitudes}")
    pairs = [pair for seed in seeds for name in scenarios for pair in sample_pairs(name, seed, PER_BIN).pairs]
    results = list(join_all(pairs, options.amplitudes))
    if options.format == "json":
        print(document(study="bends", pairs=results))
    else:
        summary(results).print()


def join_all(pairs: Sequence[SubmapPair], amplitudes: Sequence[float]) -> Iterator[BendResult]:
    """Results of all pairs that overlap, and of maps of different buildings."""
    strangers = [pair for one, other in _of_different_plans(pairs) for pair in negative_pairs([one], [other])]
    for amplitude in amplitudes:
        for k, pair in enumerate([*(pair for pair in pairs if pair.bin in BINS), *strangers]):
            yield join(pair, amplitude, stream(pair.seed, pair.scenario, "bends", k))


def _of_different_plans(pairs: Sequence[SubmapPair]) -> Iterator[tuple[SubmapPair, SubmapPair]]:
    """Every pair with one of another floor plan, far from it in the list."""
    for k, one in enumerate(pairs):
        for other in (*pairs[k + len(pairs) // 2 :], *pairs[: k + len(pairs) // 2]):
            if other.scenario != one.scenario and not {one.scenario, other.scenario} <= set(SAME_PLAN):
                yield one, other
                break


def join(pair: SubmapPair, amplitude: float, rng: np.random.Generator) -> BendResult:
    """What becomes of a pair whose second map is bent by ``amplitude`` m."""
    field = SmoothField.draw(amplitude, rng)
    bent = bend_map(pair.b, field)
    result, seconds = timed(align, pair.a, bent, None, CONFIG)
    best = result.best if isinstance(result, NoStitch) else result
    rigid = shaped = np.nan
    if best is not None and pair.bin in BINS:
        walls = bent.points.points
        truth = se2.transform(pair.T_a_b, field.undone(walls))
        rows = _shared(pair.a.points.points, truth)
        rigid = shaped = _miss(se2.transform(best.T_a_b, walls[rows]), truth[rows])
        if best.bend is not None:
            shaped = _miss(best.bend.apply(walls[rows]), truth[rows])
    was_bent = best is not None and best.bend is not None
    about = pair.scenario, pair.seed, pair.bin, amplitude, isinstance(result, Stitch), was_bent
    return BendResult(*about, rigid, shaped, seconds)


def _shared(walls: Array, truth: Array) -> np.ndarray:
    """Rows of ``truth (n, 2)`` m that lie at one of the ``walls (m, 2)``; all where none does."""
    rows = np.flatnonzero(cKDTree(walls).query(truth)[0] < SHARED)
    return rows if len(rows) else np.arange(len(truth))


def _miss(places: Array, truth: Array) -> float:
    return float(np.mean(np.linalg.norm(places - truth, axis=1)))


def summary(results: Sequence[BendResult]) -> Table:
    """A row for each overlap and amplitude; errors are medians of the right ones."""
    rows = []
    for name, amplitude in dict.fromkeys((result.bin, result.amplitude_m) for result in results):
        own = [one for one in results if (one.bin, one.amplitude_m) == (name, amplitude)]
        right, accepted = [one for one in own if one.right], [one for one in own if one.accepted]
        rigid, bent = (
            number(float(np.median([getattr(one, what) for one in right])) if right else np.nan, 3)
            for what in ("rigid_m", "bent_m")
        )
        wrong = sum(not one.right for one in accepted)
        seconds = number(float(np.median([one.seconds for one in own])), 2)
        counts = (str(len(own)), str(len(right)), str(len(accepted)), f"{wrong}/{len(accepted)}")
        rows.append((name, number(amplitude, 1), *counts, rigid, bent, seconds))
    rows.sort(key=lambda row: [*BINS].index(row[0]) if row[0] in BINS else len(BINS))
    columns = ("overlap", "bend [m]", "pairs", "best is right", "accepted", "wrong of accepted")
    return Table((*columns, "rigid [m]", "bent [m]", "s"), rows, "Maps bent by known fields").grouped()
