"""How often two submaps of one building are joined rightly, wrongly or not at all, by true overlap."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from itertools import product
from typing import Literal

import numpy as np

from scenarios.ablate.options import StitchingOptions
from scenarios.ablate.pair_sampling import (
    ALL_BINS,
    BINS,
    PairSample,
    SubmapPair,
    bins_of,
    quota_of,
    sample_pairs,
)
from scenarios.ablate.statistics import NAN, Proportion
from scenarios.ablate.trial_io import stream
from scenarios.jsonable import document
from scenarios.options import parse_names
from scenarios.stages import timed
from scenarios.sweep import Answer, Failure, SweepResult, Trial, finish, write_results
from slam import se2
from slam.cli import InputError
from slam.mapping.occupancy import Grid
from slam.se2 import Array
from slam.table import Columns, Table, number
from stitch.align import METHODS, AlignConfig, NoStitch, Prior, Stitch, align

Outcome = Literal["right", "false", "refused"]

PAIRS = "pairs"
"""The trial of a building that lists its pairs; the others align them."""
LIMIT = (0.3, np.radians(2.0))
"""An alignment is right within this (m at the middle of the overlap, rad)."""
PRIOR_SIGMA = np.array([1.0, 1.0, np.radians(10.0)])
"""Standard deviation of the prior (m, m, rad); its error is drawn from it."""
WITH_PRIOR = ("joint",)
"""Methods that are measured with a prior as well: of the others only Formsma's reads a part of it."""
HELD = 1.0
"""Pairs that share less wall [m] across some direction can slide: what they share is a bare corridor."""
ALL = "all"
"""The bin of all bins together."""


@dataclass(frozen=True)
class AlignmentRow:
    """One method on one pair: errors are NaN where it was refused, ``nees`` where it has no covariance."""

    variant: str
    scenario: str
    seed: int
    bin: str
    overlap: float
    moved: bool
    hold: float
    outcome: Outcome
    error_m: float
    error_deg: float
    nees: float
    seconds: float
    reason: str


@dataclass(frozen=True)
class BuildingResult:
    """The rows of one building, pair by pair, how many of its fragments were bent, and the sizes of its
    pairs' maps by `map_size`."""

    rows: tuple[AlignmentRow, ...]
    stretches: int
    bent: int
    sizes: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class BinSummary:
    """One method in one bin: proportions of all pairs, but ``false`` of the ``accepted``; ``anees`` is that
    of the right alignments / 3 (a false one is beyond any covariance), NaN where none has a covariance."""

    method: str
    bin: str
    pairs: int
    accepted: int
    right: Proportion
    false: Proportion
    refused: Proportion
    median_s: float
    anees: float


COLUMNS: Columns = (
    ("method", lambda one: one.method),
    ("overlap", lambda one: one.bin),
    ("pairs", lambda one: str(one.pairs)),
    ("right", lambda one: str(one.right)),
    ("false of accepted", lambda one: f"{one.false.count}/{one.accepted}"),
    ("refused", lambda one: str(one.refused)),
    ("ms", lambda one: f"{1e3 * one.median_s:.0f}"),
    ("ANEES/3", lambda one: number(one.anees, 2)),
)


def run(options: StitchingOptions) -> None:
    """Sample buildings until the bins are full, and print what the methods made of the pairs."""
    methods = parse_names(options.methods or ",".join(METHODS), METHODS, "method")
    scenarios, seeds = options.checked()
    if options.pairs < 1:
        raise InputError(f"expected --pairs > 0, got {options.pairs}")
    if not 0.0 < options.length[0] <= options.length[1]:
        raise InputError(f"--length: expected metres, 0 < shortest <= longest, got {options.length}")
    bins = BinCounts(options.pairs)
    buildings = [(name, seed) for seed, name in product(seeds, scenarios)]
    swept = options.sweep(
        trials(buildings, methods, bins, options.length),
        run_trial,
        prepare=partial(sample_pairs, most=options.pairs, length=options.length),
        each=bins.take,
    )
    results = truncate_to_quota(swept, options.pairs)
    rows = [row for result in results for row in result.rows]
    if not rows and not swept.failed:
        raise InputError(
            f"no pairs: none of {options.scenarios} with seeds {options.seeds} has stretches that overlap"
        )
    write_results(options.out / "results.csv", [f.name for f in fields(AlignmentRow)], map(asdict, rows))
    everything = summarise(rows, ALL_BINS)
    held = summarise([row for row in rows if row.hold >= HELD], BINS)
    if options.format == "json":
        about = {"study": "stitching", "seeds": options.seeds, "scenarios": scenarios}
        lines = [*everything, *(replace(one, bin=f"{one.bin} held") for one in held)]
        print(document(**about, buildings=len(results), lines=lines))
    else:
        title = f"stitching: {len(results)} buildings, seeds {options.seeds}"
        Table.of(everything, COLUMNS, title, names=2, notes=notes(results)).grouped().print()
        title = f"of these, pairs whose shared walls hold them by {HELD:g} m in every direction"
        Table.of(held, COLUMNS, title, names=2).grouped().print()
    finish(swept, options.store)


@dataclass
class BinCounts:
    """How many pairs each bin has, of the ``most`` that it takes."""

    most: int
    counts: Counter[str] = field(default_factory=Counter)

    def is_open(self, scenario: str) -> bool:
        """Whether a building of the scenario may still help to fill a bin."""
        return any(self.counts[name] < self.most for name in bins_of(scenario))

    def put(self, name: str) -> bool:
        """Count a pair; False where its bin is full."""
        if self.counts[name] >= self.most:
            return False
        self.counts[name] += 1
        return True

    def take(self, trial: Trial, result: Answer | Failure) -> None:
        """Count the pairs of a building as soon as they are known."""
        if trial.method == PAIRS and isinstance(result, Answer):
            for name in result.rows[0]["bins"]:
                self.put(name)


def trials(
    buildings: Sequence[tuple[str, int]], methods: Sequence[str], bins: BinCounts, length: tuple[float, float]
) -> Iterator[Trial]:
    """For every building (scenario, seed) that may still fill a bin: its pairs, and every method's results.

    ``length``: distance driven for the shortest and the longest submap [m].
    """
    variants = [one for one in product(methods, (False, True)) if one[0] in WITH_PRIOR or not one[1]]
    for scenario, seed in buildings:
        if not bins.is_open(scenario):
            continue
        settings = {"quota": quota_of(scenario, bins.most), "length": list(length)}
        yield Trial("stitching", scenario, seed, PAIRS, settings)
        for method, prior in variants:
            name = f"{method} + prior" if prior else method
            yield Trial("stitching", scenario, seed, name, settings | {"method": method, "prior": prior})


def run_trial(trial: Trial, sample: PairSample) -> Answer:
    """One row that counts the pairs of a building, or a method's rows for them."""
    if trial.method == PAIRS:
        sizes = [map_size(submap.grid) for pair in sample.pairs for submap in (pair.a, pair.b)]
        bins = [pair.bin for pair in sample.pairs]
        return Answer([{"bins": bins, "stretches": sample.stretches, "bent": sample.bent, "sizes": sizes}])
    rows = align_pairs(sample.pairs, trial.method, trial.config["method"], trial.config["prior"])
    return Answer([asdict(row) for row in rows])


def align_pairs(pairs: Sequence[SubmapPair], name: str, method: str, guided: bool) -> list[AlignmentRow]:
    """A row for each pair under the ``name`` of the variant; if ``guided``, each pair has its own prior."""
    config = AlignConfig(method=method)
    if pairs:
        align(pairs[0].a, pairs[0].b, None, config)  # load its kernels before its time is taken
    rows = []
    for k, pair in enumerate(pairs):
        rng = stream(pair.seed, pair.scenario, "priors", k)
        prior = draw_prior(pair.T_a_b, rng) if guided else None
        result, seconds = timed(align, pair.a, pair.b, prior, config)
        outcome, error, nees = score_alignment(result, pair.T_a_b, pair.middle_b)
        about = pair.scenario, pair.seed, pair.bin, pair.overlap, pair.moved, pair.hold
        reason = result.reason if isinstance(result, NoStitch) else ""
        rows.append(AlignmentRow(name, *about, outcome, *error, nees, seconds, reason))
    return rows


def draw_prior(T_a_b: Array, rng: np.random.Generator) -> Prior:
    """A prior of `PRIOR_SIGMA` whose error is as large as it says."""
    return Prior(se2.compose(T_a_b, PRIOR_SIGMA * rng.standard_normal(3)), np.diag(PRIOR_SIGMA**2))


def score_alignment(
    result: Stitch | NoStitch, T_a_b: Array, middle_b: Array, limit: tuple[float, float] = LIMIT
) -> tuple[Outcome, tuple[float, float], float]:
    """Outcome, error (m at b's point ``middle_b (2,)``, degrees) and squared Mahalanobis error."""
    if isinstance(result, NoStitch):
        return "refused", (NAN, NAN), NAN
    distance, angle = pose_error(result.T_a_b, T_a_b, middle_b)
    nees = NAN
    if result.covariance is not None:
        xi = se2.log(se2.between(T_a_b, result.T_a_b))
        nees = float(xi @ np.linalg.solve(result.covariance, xi))
    outcome: Outcome = "right" if is_right(result.T_a_b, T_a_b, middle_b, limit) else "false"
    return outcome, (distance, float(np.degrees(angle))), nees


def pose_error(T_a_b: Array, truth: Array, middle_b: Array) -> tuple[float, float]:
    """Distance of two poses ``(3,)`` of b in a from each other: m at b's point ``middle_b (2,)``, rad."""
    moved = se2.transform(T_a_b, middle_b[None]) - se2.transform(truth, middle_b[None])
    return float(np.linalg.norm(moved)), abs(float(se2.wrap(T_a_b[2] - truth[2])))


def is_right(T_a_b: Array, truth: Array, middle_b: Array, limit: tuple[float, float] = LIMIT) -> bool:
    """Whether a pose ``(3,)`` of b in a is within ``limit`` (m, rad) of the truth."""
    distance, angle = pose_error(T_a_b, truth, middle_b)
    return distance <= limit[0] and angle <= limit[1]


def map_size(grid: Grid) -> tuple[float, float]:
    """Longer and shorter side [m] of the smallest rectangle, however turned, round the known cells."""
    import cv2

    known = np.argwhere(grid.occupied | grid.free).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(known)
    long, short = sorted([(side + 1.0) * grid.resolution for side in sides], reverse=True)
    return long, short


def truncate_to_quota(swept: SweepResult, most: int) -> list[BuildingResult]:
    """Results of the buildings that helped to fill a bin, in their order, without the pairs beyond ``most``
    in a bin: the same however many surplus pairs parallel workers computed."""
    bins, results = BinCounts(most), list[BuildingResult]()
    by_building: dict[tuple[str, int], list[Answer]] = {}
    for trial, result in swept.answered:
        if trial.method == PAIRS or trial.drive in by_building:
            by_building.setdefault(trial.drive, []).append(result)
    for listed, *aligned in by_building.values():
        (about,) = listed.rows
        kept = [k for k, name in enumerate(about["bins"]) if bins.put(name)]
        rows = tuple(AlignmentRow(**result.rows[k]) for k in kept for result in aligned)
        if rows:
            sizes = tuple((long, short) for k in kept for long, short in about["sizes"][2 * k : 2 * k + 2])
            results.append(BuildingResult(rows, about["stretches"], about["bent"], sizes))
    return results


def summarise(rows: Sequence[AlignmentRow], bins: Collection[str]) -> list[BinSummary]:
    """A summary per method and bin that has pairs, and one over all bins for each method."""
    summaries = []
    for variant in dict.fromkeys(row.variant for row in rows):
        own = [row for row in rows if row.variant == variant]
        parts = {name: [row for row in own if row.bin == name] for name in bins} | {ALL: own}
        for name, part in parts.items():
            if part:
                counts = count_outcomes([row.outcome for row in part])
                seconds = float(np.median([row.seconds for row in part]))
                nees = [row.nees for row in part if row.outcome == "right" and np.isfinite(row.nees)]
                anees = float(np.mean(nees)) / 3.0 if nees else NAN
                summaries.append(BinSummary(variant, name, len(part), *counts, seconds, anees))
    return summaries


def count_outcomes(outcomes: Sequence[str]) -> tuple[int, Proportion, Proportion, Proportion]:
    """How many are accepted, and the shares of the right of all, the false of these, the refused of all."""
    right, false, refused = (outcomes.count(outcome) for outcome in ("right", "false", "refused"))
    accepted, n = right + false, len(outcomes)
    return accepted, Proportion.of(right, n), Proportion.of(false, accepted), Proportion.of(refused, n)


def notes(results: Sequence[BuildingResult]) -> list[str]:
    """What stands below the table."""
    if not results:
        return ["no building gave an answer"]
    cut, bent = sum(result.stretches for result in results), sum(result.bent for result in results)
    long, short = np.median([side for result in results for side in result.sizes], axis=0)
    return [
        "right and refused: share of the bin's pairs [95 % interval]; ms: median processor time; "
        "ANEES/3: of the right ones, 1 is honest",
        f"the maps' rectangles are {long:.0f} × {short:.0f} m in the median",
        f"{bent} of {cut} stretches were bent by more than 0.15 m or 1° and left out",
    ]
