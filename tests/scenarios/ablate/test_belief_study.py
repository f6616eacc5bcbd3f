"""How far an alignment may be believed is learnt: from what, and what comes of it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.ablate import pair_sampling, training
from scenarios.ablate.options import BeliefOptions as Options
from scenarios.ablate.pair_sampling import (
    STRANGERS,
    PairSample,
    SubmapPair,
    furniture_is_moved,
    negative_pairs,
    training_pairs,
)
from scenarios.ablate.study import belief
from scenarios.ablate.study.belief import LENGTHS, accepted_table, run
from scenarios.ablate.training import Dataset, collect_samples, cross_validate, fit_network
from slam.cli import InputError
from slam.se2 import Array
from stitch.alignment.acceptance import AcceptanceClassifier
from tests.scenarios.ablate.tiny_pair import tiny_pair


@pytest.fixture(scope="module")
def pair() -> SubmapPair:
    return tiny_pair()


def test_what_no_straight_line_tells_apart_is_learnt() -> None:
    """Right where two features have the same sign."""
    rng = np.random.default_rng(0)
    features = rng.normal(size=(3000, 2))
    right = features[:, 0] * features[:, 1] > 0.0
    network = fit_network(features, right, rng)
    unseen = rng.normal(size=(2000, 2))
    unseen = unseen[np.abs(unseen).min(axis=1) > 0.2]
    assert np.mean((network.log_odds(unseen) > 0.0) == (unseen[:, 0] * unseen[:, 1] > 0.0)) > 0.97


def test_log_odds_are_as_sure_as_the_examples() -> None:
    """Of features that tell nothing, those of the share that is right."""
    rng = np.random.default_rng(0)
    network = fit_network(rng.normal(size=(2000, 3)), np.arange(2000) % 4 == 0, rng)
    assert float(np.median(network.log_odds(rng.normal(size=(500, 3))))) == pytest.approx(
        np.log(1.0 / 3.0), abs=0.25
    )


def test_no_building_is_judged_by_what_was_learnt_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    building = np.repeat(np.arange(200, 212), 5)
    features = np.column_stack([building, building]).astype(float)
    judged: list[set[int]] = []

    class Told:
        def __init__(self, learnt_from: Array) -> None:
            self.seen = set(learnt_from[:, 0].astype(int).tolist())

        def log_odds(self, features: Array) -> Array:
            judged.append(set(features[:, 0].astype(int).tolist()))
            assert not judged[-1] & self.seen
            assert len(judged[-1] | self.seen) == 12
            return np.zeros(len(features))

    monkeypatch.setattr(training, "fit_network", lambda some, *_: Told(some))
    assert np.all(cross_validate(features, np.arange(60) % 2 == 0, building, rng) == 0.0)
    assert set().union(*judged) == set(range(200, 212))


def test_lessons_of_a_pair_hold_the_truth(pair: SubmapPair) -> None:
    alone = collect_samples([pair, *negative_pairs([pair], [pair])], False, np.random.default_rng(0))
    assert alone.features.shape == (2, 39)
    assert alone.right.tolist() == [True, False]  # no map is of another building, whatever it looks like
    assert alone.bin.tolist() == ["50 %", STRANGERS]
    assert not alone.guided.any()
    told = collect_samples([pair], True, np.random.default_rng(0))
    assert told.guided.all()
    assert told.features[0, -1] == 1.0
    assert collect_samples([], False, np.random.default_rng(0)).features.shape == (0, 39)


def test_packed_lessons_come_back(pair: SubmapPair) -> None:
    before = collect_samples([pair], False, np.random.default_rng(0))
    again = Dataset.from_bytes(before.to_bytes())
    for name, found in vars(again).items():
        np.testing.assert_array_equal(found, getattr(before, name))


def test_furniture_is_moved_in_every_building_once(monkeypatch: pytest.MonkeyPatch, pair: SubmapPair) -> None:
    """Where the study moves it there is nothing to add."""

    def harvest(scenario: str, seed: int, most: int, length: object, moved: bool | None = None) -> PairSample:
        moved = furniture_is_moved(scenario, seed) if moved is None else moved
        return PairSample((replace(pair, seed=seed, moved=moved),), 2, 0)

    monkeypatch.setattr(pair_sampling, "sample_pairs", harvest)
    seeds = range(200, 206)
    assert sum(furniture_is_moved("beehive", seed) for seed in seeds) == 2
    for seed in seeds:
        usual, besides = training_pairs("beehive", seed)
        assert [p.moved for p in (*usual, *besides)].count(True) == 1
        assert len(besides) == (not furniture_is_moved("beehive", seed))


def test_the_command_writes_a_network(
    pair: SubmapPair, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = []

    def training_pairs(scenario: str, seed: int, length: tuple[float, float]) -> Any:
        asked.append((scenario, seed, length))
        return (replace(pair, seed=seed),), ()

    monkeypatch.setattr(belief, "training_pairs", training_pairs)
    written = tmp_path / "belief.npz"
    run(Options(scenarios="beehive", seeds="200,201", network=written, workers=1, out=tmp_path / "out"))
    printed = capsys.readouterr()
    assert asked == [("beehive", seed, length) for length in LENGTHS for seed in (200, 201)]
    with np.load(written) as stored:
        network = AcceptanceClassifier(**stored)
    assert network.inner.shape == (39, 48)
    assert "learnt from 12 alignments, 8 of them right" in printed.out
    assert printed.out.count("with prior") == 8


def test_accepted_are_those_believed_and_allowed() -> None:
    """Of four: right and believed, right and not allowed, wrong and believed, a stranger not believed."""
    known = Dataset(
        np.zeros((4, 39)),
        np.array([True, True, False, False]),
        np.array([True, False, True, True]),
        np.zeros(4, bool),
        np.array(["50 %", "50 %", "80 %", STRANGERS]),
        np.arange(4),
    )
    rows = accepted_table(known, np.array([3.0, 3.0, 3.0, -0.2])).rows
    at_even = next(row for row in rows if row[:2] == ("without prior", "0.0"))
    assert at_even[2:] == ("–", "–", "0.500", "0.000", "1/2", "0/1")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (Options(seeds="0-5"), "from 100 on"),
        (Options(seeds="300"), "two or more"),
        (Options(scenarios="hospitl"), "did you mean 'hospital'"),
        (Options(workers=-1), "--workers >= 0"),
    ],
)
def test_bad_options(options: Options, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        run(options)


def test_reported_seeds_are_refused(ablate: Callable[..., Any]) -> None:
    done = ablate("belief", "--seeds", "98-101")
    assert done.code == 2
    assert "expected seeds from 100 on" in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("name", ["likeness", "belief", "confidence"])
def test_without_scikit_learn_the_extra_is_named(
    ablate: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, name: str, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "sklearn", None)
    done = ablate(name, "-o", tmp_path)
    assert done.code == 2
    assert done.stderr.endswith("training needs scikit-learn: pip install 'slamstitch[train]'\n")
    assert done.stderr.count("\n") == 1
