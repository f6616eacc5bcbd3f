"""Studies: their pairs are what they claim, answers are counted rightly, and workers change nothing."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.ablate.map_fragments import CELL, LENGTH, MapFragment, rearrange, warp
from scenarios.ablate.options import STUDIES
from scenarios.ablate.pair_sampling import (
    BINS,
    NONE,
    TWINS,
    PairSample,
    SubmapPair,
    bin_of,
    frame_near,
    overlap_of,
    sample_pairs,
)
from scenarios.ablate.study.stitching import (
    ALL,
    PAIRS,
    AlignmentRow,
    BinCounts,
    align_pairs,
    draw_prior,
    map_size,
    notes,
    run_trial,
    score_alignment,
    summarise,
    trials,
    truncate_to_quota,
)
from scenarios.ablate.trial_io import stream
from scenarios.sweep import Answer, Trial, sweep
from sim.floorplan import Prism, box, cupboard, table
from slam import se2
from slam.mapping.occupancy import Grid
from stitch.align import NoStitch, Stitch

Command = Callable[..., Any]
ROOM = [
    box([3.0, 0.0, 0.0], 6.0, 0.1, kind="wall"),
    box([3.0, 6.0, 0.0], 6.0, 0.1, kind="wall"),
    box([0.0, 3.0, np.pi / 2], 6.0, 0.1, kind="wall"),
    box([6.0, 3.0, np.pi / 2], 6.0, 0.1, kind="wall"),
]
ROUTE = np.array([[3.0, 2.5], [3.0, 3.5]])


@pytest.fixture(scope="module")
def hives() -> tuple[SubmapPair, ...]:
    """Pairs from two visits to one beehive, furniture moved between them."""
    return sample_pairs("beehive", 102, 1).pairs


def row(outcome: str, where: str = "30 %", nees: float = np.nan, variant: str = "joint") -> AlignmentRow:
    return AlignmentRow(variant, "hospital", 0, where, 0.3, False, 2.0, outcome, 0.0, 0.0, nees, 0.5, "")  # type: ignore[arg-type]


def piece(known: list[list[int]], frames: np.ndarray, middles: np.ndarray) -> MapFragment:
    return MapFragment(None, np.array(known), frames, middles)  # type: ignore[arg-type]


def test_bins_are_by_share_and_twins_apart() -> None:
    assert bin_of(0.10, "hospital") == "15 %"
    assert bin_of(0.20, "hospital") is None
    assert bin_of(0.25, "hospital") == "30 %"
    assert bin_of(0.89, "hospital") == "80 %"
    assert bin_of(0.0, "hospital") == NONE
    assert bin_of(0.005, "hospital") is None
    assert bin_of(0.005, "twin_rooms") == TWINS


def test_overlap_by_hand() -> None:
    """Of four and three cells two are the same; negative cells count as well."""
    nothing = np.zeros((1, 3))
    a = piece([[0, 0], [1, 0], [-5, 2], [7, 7]], nothing, nothing[:, :2])
    b = piece([[1, 0], [-5, 2], [0, 1]], nothing, nothing[:, :2])
    cells, share = overlap_of(a, b)
    assert sorted(cells.tolist()) == [[-5, 2], [1, 0]]
    assert share == pytest.approx(2.0 / 3.0)


def test_the_pairs_overlap_as_much_as_their_bin_says(hives: tuple[SubmapPair, ...]) -> None:
    """Counted anew, from the maps themselves laid on each other at the true pose."""
    assert {pair.bin for pair in hives} >= {"50 %", "80 %"}
    for pair in hives:
        if pair.bin not in BINS:
            continue
        low, high = BINS[pair.bin]
        assert low <= pair.overlap < high
        known = [_known(pair.a, np.zeros(3)), _known(pair.b, pair.T_a_b)]
        share = len(known[0] & known[1]) / min(map(len, known))
        assert share == pytest.approx(pair.overlap, abs=0.06)
        assert pair.moved


def _known(submap, T: np.ndarray) -> set[tuple[int, int]]:
    rows, columns = np.nonzero(submap.grid.occupied | submap.grid.free)
    centres = submap.grid.origin + (np.stack([columns, rows], -1) + 0.5) * submap.grid.resolution
    return set(map(tuple, np.floor(se2.transform(T, centres) / CELL).astype(int).tolist()))


def test_walls_coincide_at_the_true_pose(hives: tuple[SubmapPair, ...]) -> None:
    for pair in hives:
        if pair.bin == "80 %":
            moved = se2.transform(pair.T_a_b, pair.b.grid.occupied_points())
            near = {tuple(c) for c in np.floor(pair.a.grid.occupied_points() / 0.3).astype(int)}
            on = np.mean([tuple(c) in near for c in np.floor(moved / 0.3).astype(int)])
            assert on > 0.6


def test_the_frame_of_a_bent_map_is_that_of_the_place() -> None:
    """Half the scans say the map lies a metre further: near them, it does."""
    frames = np.array([[0.0, 0.0, 0.0]] * 5 + [[1.0, 0.0, 0.1]] * 5)
    middles = np.array([[0.0, 0.0]] * 5 + [[40.0, 0.0]] * 5)
    bent = piece([[0, 0]], frames, middles)
    np.testing.assert_allclose(frame_near(bent, np.array([0.0, 0.0])), [0.0, 0.0, 0.0], atol=2e-3)
    near = frame_near(bent, np.array([40.0, 0.0]))
    at_place = se2.transform(se2.inverse(near), np.array([[40.0, 0.0]]))
    expected = se2.transform(se2.inverse(frames[-1]), np.array([[40.0, 0.0]]))
    np.testing.assert_allclose(at_place, expected, atol=0.02)


def test_warp_of_a_rigid_map_is_none() -> None:
    places = np.array([[0.0, 0.0], [5.0, 1.0], [9.0, 7.0]])
    assert warp(np.tile([3.0, -2.0, 0.7], (3, 1)), places) == pytest.approx(0.0, abs=1e-9)
    bent = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, np.radians(6.0)]])
    assert warp(bent, places) > 1.0


def test_a_judge_measures_at_the_overlap() -> None:
    """One degree of error ten metres away is 17 cm, whatever it is at the origin."""
    T = np.array([1.0, 2.0, 0.5])
    off = se2.compose(T, [0.0, 0.0, np.radians(1.0)])
    stitch = Stitch(off, np.diag([0.1, 0.1, np.radians(0.5)]) ** 2, 1.0, 10.0, 1.0)
    outcome, error, nees = score_alignment(stitch, T, np.array([10.0, 0.0]))
    assert outcome == "right"
    assert error == pytest.approx((2.0 * 10.0 * np.sin(np.radians(0.5)), 1.0))
    assert nees == pytest.approx(4.0)
    assert score_alignment(stitch, T, np.array([20.0, 0.0]))[0] == "false"
    assert score_alignment(NoStitch("no"), T, np.zeros(2))[0] == "refused"
    turned = replace(stitch, T_a_b=se2.compose(T, [0.0, 0.0, np.radians(2.1)]), covariance=None)
    outcome, _, nees = score_alignment(turned, T, np.zeros(2))
    assert outcome == "false"
    assert np.isnan(nees)


def test_priors_are_as_wrong_as_they_say() -> None:
    rng = np.random.default_rng(0)
    T = np.array([3.0, -1.0, 2.0])
    distances = [float(draw_prior(T, rng).distance(T[None])[0]) for _ in range(400)]
    assert np.mean(distances) == pytest.approx(3.0, abs=0.4)


def test_counting_by_hand() -> None:
    rows = [row("right", nees=3.0), row("right", nees=6.0), row("false", nees=900.0), row("refused")]
    rows += [row("refused", NONE), row("false", NONE)]
    first, none, everything = summarise(rows, [*BINS, NONE, TWINS])
    assert (first.bin, none.bin, everything.bin) == ("30 %", NONE, ALL)
    assert (first.right.count, first.pairs) == (2, 4)
    assert (first.false.count, first.accepted) == (1, 3)
    assert first.anees == pytest.approx(1.5)
    assert (none.false.count, none.accepted, none.refused.share) == (1, 1, 0.5)
    assert (everything.false.count, everything.accepted) == (2, 4)
    assert everything.median_s == 0.5


def test_some_furniture_moves_within_its_room_and_walls_do_not() -> None:
    prisms = [*ROOM, *cupboard([0.8, 0.4, 0.0]), *table([4.5, 4.8, 0.0]), *cupboard([5.2, 1.0, 1.57])]
    after = rearrange(tuple(prisms), ROUTE, np.random.default_rng(1))
    assert after[:4] == tuple(ROOM)
    corners = np.concatenate([prism.footprint for prism in after[4:]])
    assert np.all((corners > 0.0) & (corners < 6.0))
    assert np.min(np.linalg.norm(corners[:, None] - ROUTE, axis=2)) > 0.45
    stayed = {prism.footprint.tobytes() for prism in after}
    assert any(prism.footprint.tobytes() not in stayed for prism in prisms)


def test_a_table_keeps_its_legs() -> None:
    prisms = (*ROOM, *table([2.0, 1.2, 0.0]))
    for seed in range(6):
        after = rearrange(prisms, ROUTE, np.random.default_rng(seed))
        assert len(after) in (4, 4 + 5)
        if len(after) == 9:
            top, legs = after[4], after[5:]
            assert _spread([top, *legs]) == pytest.approx(_spread([top]), abs=1e-9)


def _spread(prisms: list[Prism]) -> float:
    corners = np.concatenate([prism.footprint for prism in prisms])
    return float(np.max(np.linalg.norm(corners[:, None] - corners, axis=2)))


def counted(trial: Trial, bins: list[str]) -> Answer:
    """A stand-in for the study: every pair is refused."""
    if trial.method == PAIRS:
        sizes = [(30.0 + k, 20.0) for k in range(2 * len(bins))]
        return Answer([{"bins": bins, "stretches": 7, "bent": 1, "sizes": sizes}])
    return Answer([asdict(row("refused", where, variant=trial.method)) for where in bins])


@pytest.mark.parametrize("scenario", ["hospital", "twin_rooms"])
def test_buildings_are_visited_until_the_bins_are_full(scenario: str) -> None:
    """Each has two pairs of every bin that its scenario can fill; three are wanted."""
    where = [TWINS] if scenario == "twin_rooms" else [*BINS, NONE]
    bins = BinCounts(3)
    buildings = [(scenario, seed) for seed in range(9)]
    swept = sweep(
        trials(buildings, ["orb", "joint"], bins, LENGTH),
        counted,
        None,
        prepare=lambda *_: where * 2,
        each=bins.take,
        workers=1,
    )
    assert [trial.seed for trial in swept.trials] == [0] * 4 + [1] * 4
    assert [trial.method for trial in swept.trials[:4]] == [PAIRS, "orb", "joint", "joint + prior"]
    first, second = truncate_to_quota(swept, 3)
    assert (len(first.rows), len(second.rows)) == (3 * 2 * len(where), 3 * len(where))
    assert [one.variant for one in first.rows[:3]] == ["orb", "joint", "joint + prior"]
    assert [one.bin for one in second.rows[::3]] == where
    assert (second.stretches, second.bent) == (7, 1)
    assert second.sizes == tuple((30.0 + k, 20.0) for k in range(2 * len(where)))  # two maps a pair


def test_a_study_in_which_every_building_failed_still_has_notes() -> None:
    assert notes([]) == ["no building gave an answer"]


def test_pairs_are_counted_by_a_trial_of_their_own(hives: tuple[SubmapPair, ...]) -> None:
    found = PairSample(hives, 20, 3)
    (row,) = run_trial(Trial("stitching", "beehive", 102, PAIRS, {"quota": 1}), found).rows
    sizes = [map_size(submap.grid) for pair in hives for submap in (pair.a, pair.b)]
    assert row == {"bins": [pair.bin for pair in hives], "stretches": 20, "bent": 3, "sizes": sizes}
    assert all(short <= long < 40.0 for long, short in sizes)  # the building is 26 × 24 m


def test_the_size_of_a_map_does_not_depend_on_how_it_lies() -> None:
    """6 × 2 m of cells of 0.1 m, straight and slanting, when their corners stand out."""
    straight = np.zeros((40, 80), dtype=bool)
    straight[10:30, 10:70] = True
    y, x = np.mgrid[:80, :80] - 40.0
    along, across = x * np.cos(0.5) + y * np.sin(0.5), y * np.cos(0.5) - x * np.sin(0.5)
    slanting = (np.abs(along) < 30.0) & (np.abs(across) < 10.0)
    for seen in (straight, slanting):
        grid = Grid(np.zeros_like(seen), seen, np.zeros(2), 0.1)
        assert map_size(grid) == pytest.approx((6.0, 2.0), abs=0.15)


def test_a_worker_answers_as_this_process_does(
    hives: tuple[SubmapPair, ...], ablate: Command, tmp_path: Path
) -> None:
    """The command, with two processes, against the rows made here: the same but for the time they took."""
    command = ["stitching", "--pairs", "1", "--seeds", "102", "--scenarios", "beehive", "-o", tmp_path]
    done = ablate(*command, "--methods", "htms,joint", "--workers", "2", "--format", "json")
    assert done.code == 0, done.stderr
    variants = [("htms", "htms", False), ("joint", "joint", False), ("joint + prior", "joint", True)]
    here = [one for group in zip(*(align_pairs(hives, *v) for v in variants), strict=True) for one in group]
    with (tmp_path / "results.csv").open(newline="") as file:
        there = list(csv.DictReader(file))
    assert len(there) == len(here)
    for one, other in zip(here, there, strict=True):
        expected = {name: str(value) for name, value in asdict(one).items() if name != "seconds"}
        assert expected == {name: value for name, value in other.items() if name != "seconds"}
    printed = json.loads(done.stdout)["lines"]
    assert {line["method"] for line in printed} == {"htms", "joint", "joint + prior"}
    assert sum(line["pairs"] for line in printed if line["bin"] == ALL) == len(here)


def test_from_the_shell() -> None:
    """Without a word it names the studies; a study that there is none of is exit code 2."""
    command = [sys.executable, "-m", "scenarios.ablate"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    for name in STUDIES:
        assert name in done.stdout
    done = subprocess.run([*command, "stiching"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "scenarios.ablate: unknown study 'stiching': did you mean 'stitching'?\n"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["stiching"], "did you mean 'stitching'?"),
        (["stitching", "--methods", "joynt"], "did you mean 'joint'?"),
        (["stitching", "--scenarios", "hospitl"], "did you mean 'hospital'?"),
        (["stitching", "--seeds", "9-1"], "expected first-last"),
        (["stitching", "--pairs", "0"], "--pairs > 0"),
        (["halmstad", "--data", "/nowhere"], "expected a folder"),
    ],
)
def test_bad_input_is_one_line(ablate: Command, arguments: list[str], complaint: str) -> None:
    done = ablate(*arguments)
    assert done.code == 2
    assert complaint in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def test_streams_differ_by_seed_scenario_purpose_and_index() -> None:
    """Their numbers are part of every published result: they stay."""
    draws = [
        stream(*names).random()  # type: ignore[arg-type]
        for names in [
            (5, "hospital", "sessions"),
            (5, "hospital", "pairs"),
            (5, "hospital", "priors", 0),
            (5, "hospital", "priors", 1),
            (5, "beehive", "pairs"),
            (6, "hospital", "pairs"),
        ]
    ]
    assert len(set(draws)) == 6
    assert draws[1] == np.random.default_rng([5, zlib.crc32(b"hospital"), 3]).random()
    assert draws[3] == np.random.default_rng([5, zlib.crc32(b"hospital"), 4, 1]).random()
