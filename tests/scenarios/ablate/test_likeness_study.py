"""What is learnt from alignments: known answers come back, and the command prints what it learnt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.ablate import pair_sampling
from scenarios.ablate.options import LikenessOptions as Options
from scenarios.ablate.pair_sampling import PairSample, SubmapPair
from scenarios.ablate.study.likeness import run
from scenarios.ablate.study.stitching import LIMIT, draw_prior, is_right, pose_error
from scenarios.ablate.training import CountedAlignments, fit_likelihood, fit_prior_offset
from slam.cli import InputError
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from tests.scenarios.ablate.tiny_pair import tiny_pair


@pytest.fixture(scope="module")
def pair() -> SubmapPair:
    return tiny_pair()


def examples(
    counts: Array, right: np.ndarray, unlikely: Array | None = None, gaps: Array | None = None
) -> CountedAlignments:
    """Without gaps and a prior, unless told."""
    gaps = np.zeros((len(right), 3)) if gaps is None else gaps
    guided = np.full(len(right), unlikely is not None)
    return CountedAlignments(
        counts, gaps, np.zeros(len(right)) if unlikely is None else unlikely, right, guided
    )


def chances(odds: Array, rng: np.random.Generator) -> np.ndarray:
    """Right or wrong, as often as their log-odds say."""
    return rng.uniform(size=len(odds)) < 1.0 / (1.0 + np.exp(-odds))


def test_known_weights_are_learnt() -> None:
    rng = np.random.default_rng(0)
    counts = rng.poisson(rng.uniform(1.0, 40.0, (2, 3, 7)), (6000, 2, 3, 7)).astype(float)
    counts[:, 1, 2, 6] = 0.0  # never met
    weights = rng.normal(0.0, 0.4, (2, 3, 7))
    weights[1, 2, 6] = 0.0
    gaps, by_gaps = rng.poisson(9.0, (6000, 3)).astype(float), np.array([0.3, 0.0, -0.8])
    plain = np.sum(weights * np.sqrt(counts), axis=(1, 2, 3)) + np.sqrt(gaps) @ by_gaps
    bias = 0.7 - float(plain.mean())
    found, found_gaps, constant = fit_likelihood(examples(counts, chances(plain + bias, rng), gaps=gaps))
    np.testing.assert_allclose(found, weights, atol=0.2)
    np.testing.assert_allclose(found_gaps, by_gaps, atol=0.2)
    assert found[1, 2, 6] == pytest.approx(0.0, abs=1e-6)
    odds = np.sum(found * np.sqrt(counts), axis=(1, 2, 3)) + np.sqrt(gaps) @ found_gaps + constant
    assert np.sqrt(np.mean((odds - plain - bias) ** 2)) < 0.15 * plain.std()
    assert odds.mean() == pytest.approx(0.7, abs=0.3)


def test_counts_that_tell_everything_do_not_run_away() -> None:
    """Right and wrong pose_error by one count, and by a thousand points: weights stay finite and small."""
    counts = np.zeros((400, 2, 3, 7))
    counts[:200, 0, 0, 0], counts[200:, 0, 2, 6] = 90000.0, 90000.0
    weights, _, bias = fit_likelihood(examples(counts, np.arange(400) < 200))
    assert np.abs(weights).max() < 0.1
    assert weights[0, 0, 0] > 0.0 > weights[0, 2, 6]
    assert abs(bias) < 5.0


def test_what_a_prior_adds_is_learnt() -> None:
    """Beside what the walls say and what the distance from the prior takes away."""
    rng = np.random.default_rng(1)
    counts, unlikely = rng.poisson(9.0, (20000, 2, 3, 7)).astype(float), rng.uniform(0.0, 6.0, 20000)
    weights = rng.normal(0.0, 0.3, (2, 3, 7))
    odds = np.sum(weights * np.sqrt(counts), axis=(1, 2, 3))
    bias = -float(odds.mean())
    right = chances(odds + bias - unlikely + 2.5, rng)
    known = examples(counts, right, unlikely)
    assert fit_prior_offset(known, weights, np.zeros(3), bias) == pytest.approx(2.5, abs=0.1)


def test_examples_of_a_pair_hold_the_truth(pair: SubmapPair) -> None:
    alone = CountedAlignments.of_pair(pair, None, AlignConfig())
    told = CountedAlignments.of_pair(pair, draw_prior(pair.T_a_b, np.random.default_rng(0)), AlignConfig())
    for one in (alone, told):
        assert one.counts.shape == (len(one.right), 2, 3, 7)
        assert one.gaps.shape == (len(one.right), 3)
        assert one.right.sum() == 1
    assert len(alone.right) > 1
    assert told.guided.all()
    assert not alone.guided.any()
    assert np.all(alone.unlikely == 0.0)
    assert np.all(told.unlikely > 0.0)
    same_way = alone.counts[:, 0, 0, :3].sum(axis=1)
    assert np.argmax(same_way) == np.argmax(alone.right)


def test_concatenated_in_their_order() -> None:
    first = examples(np.ones((1, 2, 3, 7)), np.array([True]), np.array([0.5]))
    second = examples(np.zeros((2, 2, 3, 7)), np.array([False, True]), np.array([1.5, 2.5]))
    both = CountedAlignments.concat([first, second])
    np.testing.assert_array_equal(both.right, [True, False, True])
    np.testing.assert_array_equal(both.unlikely, [0.5, 1.5, 2.5])
    assert both.counts[:, 0, 0, 0].tolist() == [1.0, 0.0, 0.0]
    np.testing.assert_array_equal(both.where(both.right).unlikely, [0.5, 2.5])


def test_packed_examples_come_back() -> None:
    for one in (examples(np.full((2, 2, 3, 7), 0.1), np.array([True, False])), CountedAlignments.empty()):
        other = CountedAlignments.from_bytes(one.to_bytes())
        for name in vars(one):
            before, after = getattr(one, name), getattr(other, name)
            np.testing.assert_array_equal(before, after)
            assert before.dtype == after.dtype


def test_right_is_measured_where_the_maps_meet() -> None:
    turned = np.array([0.0, 0.0, np.radians(1.9)])
    near, far = np.array([5.0, 0.0]), np.array([12.0, 0.0])
    assert pose_error(turned, np.zeros(3), near) == pytest.approx((10.0 * np.sin(turned[2] / 2.0), turned[2]))
    assert is_right(turned, np.zeros(3), near)
    assert not is_right(turned, np.zeros(3), far)
    assert not is_right(np.array([LIMIT[0] + 0.01, 0.0, 0.0]), np.zeros(3), near)
    assert not is_right(np.array([0.0, 0.0, LIMIT[1] + 0.01]), np.zeros(3), np.zeros(2))
    assert is_right(np.array([0.0, 0.0, 2.0 * np.pi]), np.zeros(3), far)


def test_the_table_is_that_of_the_code(
    pair: SubmapPair, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """One building of one pair, and one without any: what is printed can be pasted over its weights.
    Furniture is moved in both, besides the pairs in which it is not."""
    asked = []

    def harvest(scenario: str, seed: int, most: int, length: object, moved: bool | None = None) -> PairSample:
        asked.append((scenario, seed, moved))
        return PairSample((pair,) if seed == 200 and not moved else (), 2, 0)

    monkeypatch.setattr(pair_sampling, "sample_pairs", harvest)
    run(Options(scenarios="beehive", seeds="200,201", workers=1, out=tmp_path))
    printed = capsys.readouterr()
    assert asked == [("beehive", 200, None), ("beehive", 200, True), ("beehive", 201, None)]
    assert "2 trials ran" in printed.err
    said, table = printed.out.split("\n\n", 1)
    assert "without a prior, 1 of them right" in said
    pasted: dict = {"np": np}
    exec(table, pasted)
    assert pasted["WEIGHTS"].shape == (2, 3, 7)
    assert np.isfinite(pasted["WEIGHTS"]).all()
    assert np.any(pasted["WEIGHTS"] != 0.0)
    assert pasted["GAPS"].shape == (3,)
    assert np.isfinite([pasted["BIAS"], pasted["PRIOR_BONUS"]]).all()


def test_one_kind_of_alignments_teaches_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pair_sampling, "sample_pairs", lambda *_, **__: PairSample((), 0, 0))
    with pytest.raises(InputError, match="right and wrong alignments"):
        run(Options(scenarios="beehive", seeds="200", workers=1, out=tmp_path))


def test_reported_seeds_are_refused(ablate: Callable[..., Any]) -> None:
    done = ablate("likeness", "--seeds", "99-101")
    assert done.code == 2
    assert "expected seeds from 100 on" in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (Options(seeds="0"), "from 100 on"),
        (Options(seeds="300,7"), "from 100 on"),
        (Options(scenarios="hospitl"), "did you mean 'hospital'"),
        (Options(workers=-1), "--workers >= 0"),
    ],
)
def test_bad_options(options: Options, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        run(options)
