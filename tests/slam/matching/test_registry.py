"""Matchers from outside: taken by name, heard in full, and refused in one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from scenarios.methods.config import MethodConfig
from scenarios.run import with_matcher
from slam import se2
from slam.cli import InputError
from slam.matching import MATCHERS, LocalMap, Match, NoMatch, Reference, match
from slam.matching.match import register
from slam.recording import Laser
from slam.scan import Scan
from slam.se2 import Array

SCAN = Scan.from_ranges(np.full(31, 2.0), np.linspace(-1.5, 1.5, 31), Laser())
POSE = np.array([0.3, -0.2, 0.5])
GUESS = np.array([0.1, 0.0, 0.4])
REGISTERED = list(MATCHERS)


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    before = dict(MATCHERS)
    yield
    MATCHERS.clear()
    MATCHERS.update(before)


def test_a_matcher_by_name_is_asked_with_points_guess_and_prior() -> None:
    heard = []

    def told(*asked: object) -> Match:
        heard.append(asked)
        return Match.from_information(POSE, 100.0 * np.eye(3), 7)

    MATCHERS["mine"] = told
    answer = match(SCAN, SCAN, GUESS, "mine", prior_information=4.0 * np.eye(3))
    assert isinstance(answer, Match)
    assert (answer.T_reference_scan == POSE).all()
    reference, scan, guess, prior = heard[0]
    assert np.array_equal(reference.points, SCAN.points)
    assert np.array_equal(scan.points, SCAN.points)
    assert guess.tolist() == GUESS.tolist()
    assert prior.tolist() == (4.0 * np.eye(3)).tolist()
    match(SCAN, SCAN, GUESS, "mine")
    assert not heard[1][3].any()


def test_a_local_map_tells_its_points() -> None:
    local = LocalMap(3)
    assert local.points.shape == (0, 2)
    for _ in range(5):
        local.add(SCAN, POSE)
    assert local.points.shape == (3 * len(SCAN), 2)
    np.testing.assert_allclose(local.points[: len(SCAN)], se2.transform(POSE, SCAN.points))


def test_an_answer_that_is_none_is_refused() -> None:
    MATCHERS["mine"] = lambda *asked: POSE  # type: ignore[assignment, return-value]
    with pytest.raises(TypeError, match="matcher 'mine': expected a Match or a NoMatch, got ndarray"):
        match(SCAN, SCAN, GUESS, "mine")
    with pytest.raises(ValueError, match=r"method: expected one of .*'mine'.*got 'other'"):
        match(SCAN, SCAN, GUESS, "other")


def test_the_information_of_a_match_is_kept_apart_from_the_prior() -> None:
    own, prior = np.diag([400.0, 0.0, 100.0]), np.diag([0.0, 0.25, 300.0])
    found = Match.from_information(np.array([1.0, 2.0, np.pi / 2]), own, 12, prior)
    assert np.array_equal(found.information, own)
    np.testing.assert_allclose(np.diag(found.covariance), [1.0, 1 / 400, 1 / 400], atol=1e-12)  # open: 1 m
    np.testing.assert_allclose(found.information_eigenvalues, [0.25, 100.0, 400.0])
    assert found.n_matches == 12
    assert np.isnan(found.misfit)
    turned = Match.from_information(np.array([0.0, 0.0, 4.0]), own, 1).T_reference_scan
    assert turned[2] == pytest.approx(4.0 - 2 * np.pi)
    with pytest.raises(ValueError, match="expected a finite pose"):
        Match.from_information(np.full(3, np.nan), own, 1)


def test_a_module_s_function_is_known_from_then_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "somebodys_matcher.py").write_text(
        "from slam.matching import NoMatch\nN = 1\n\ndef lazy(*asked):\n    return NoMatch('no time')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    config = with_matcher(MethodConfig(), "somebodys_matcher:lazy")
    assert match(SCAN, SCAN, GUESS, config.slam.frontend.method) == NoMatch("no time")
    assert with_matcher(MethodConfig(), "") == MethodConfig()
    with pytest.raises(InputError, match="'somebodys_matcher:N': expected a function, got int"):
        with_matcher(MethodConfig(), "somebodys_matcher:N")


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("plicq", "unknown matcher 'plicq': expected one of wsm, icp, plicp"),
        ("nowhere:f", "matcher 'nowhere:f': No module named 'nowhere'"),
        ("json:f", "matcher 'json:f': module 'json' has no attribute 'f'"),
    ],
)
def test_a_name_that_leads_nowhere_is_refused(name: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        register(name)


def test_what_is_registered_keeps_its_name() -> None:
    assert [register(name) for name in REGISTERED] == REGISTERED


# On arrival: every registered matcher


@pytest.mark.parametrize("method", REGISTERED)
@pytest.mark.parametrize("seen_in", ["scan", "local map"])
def test_every_matcher_finds_the_pose_and_covers_it(
    room: Array, look: Callable[..., Scan], method: str, seen_in: str
) -> None:
    rng = np.random.default_rng(0)
    start, moved = np.array([2.0, 2.5, 0.3]), np.array([0.15, -0.08, 0.06])
    first, scan = look(room, start, rng), look(room, se2.compose(start, moved), rng)
    reference: Reference | LocalMap = Reference(first)
    if seen_in == "local map":
        reference = LocalMap(3)
        reference.add(first, np.zeros(3))
    result = match(reference, scan, moved + np.array([0.02, -0.02, 0.01]), method)
    assert isinstance(result, Match)
    error = se2.log(se2.between(result.T_reference_scan, moved))
    assert np.all(np.abs(error) < [0.04, 0.04, 0.02])
    P = result.covariance
    np.testing.assert_allclose(P, P.T, atol=1e-12)
    assert np.all(np.linalg.eigvalsh(P) > 0.0)
    assert np.all(np.diff(result.information_eigenvalues) >= 0.0)
    assert 0 < result.n_matches <= len(scan)


@pytest.mark.parametrize("method", REGISTERED)
def test_every_matcher_says_that_nothing_is_near(room: Array, look: Callable[..., Scan], method: str) -> None:
    scan = look(room, np.array([2.0, 2.5, 0.3]))
    result = match(scan, scan, np.array([500.0, 0.0, 0.0]), method)
    assert isinstance(result, NoMatch)
    assert result.reason


@pytest.mark.parametrize("method", REGISTERED)
def test_every_matcher_heeds_a_prior_that_is_certain(
    room: Array, look: Callable[..., Scan], method: str
) -> None:
    rng = np.random.default_rng(0)
    start, guess = np.array([2.0, 2.5, 0.3]), np.array([0.02, -0.02, 0.01])
    result = match(
        look(room, start, rng), look(room, start, rng), guess, method, prior_information=1e10 * np.eye(3)
    )
    assert isinstance(result, Match)
    np.testing.assert_allclose(result.T_reference_scan, guess, atol=1e-3)
