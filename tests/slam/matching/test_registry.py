"""Matchers from outside: taken by name, heard in full, and refused in one line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scenarios.methods.config import MethodConfig
from scenarios.run import with_matcher
from slam import se2
from slam.cli import InputError
from slam.matching import MATCHERS, LocalMap, Match, NoMatch, Reference, match
from slam.matching.registry import named
from slam.recording import Laser
from slam.scan import Scan

SCAN = Scan.from_ranges(np.full(31, 2.0), np.linspace(-1.5, 1.5, 31), Laser())
POSE = np.array([0.3, -0.2, 0.5])
GUESS = np.array([0.1, 0.0, 0.4])


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
        return Match.claimed(POSE, 100.0 * np.eye(3), 7)

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


def test_what_is_claimed_is_kept_apart_from_the_prior() -> None:
    told, prior = np.diag([400.0, 0.0, 100.0]), np.diag([0.0, 0.25, 300.0])
    found = Match.claimed(np.array([1.0, 2.0, np.pi / 2]), told, 12, prior)
    assert np.array_equal(found.information, told)
    np.testing.assert_allclose(np.diag(found.covariance), [1.0, 1 / 400, 1 / 400], atol=1e-12)  # open: 1 m
    np.testing.assert_allclose(found.information_eigenvalues, [0.25, 100.0, 400.0])
    assert found.n_matches == 12
    assert np.isnan(found.misfit)
    turned = Match.claimed(np.array([0.0, 0.0, 4.0]), told, 1).T_reference_scan
    assert turned[2] == pytest.approx(4.0 - 2 * np.pi)
    with pytest.raises(ValueError, match="expected a finite pose"):
        Match.claimed(np.full(3, np.nan), told, 1)


def test_a_module_s_function_is_known_from_then_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "somebodys_matcher.py").write_text(
        "from slam.matching import NoMatch\nN = 1\n\ndef lazy(*asked):\n    return NoMatch('no time')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    config = with_matcher(MethodConfig(), "somebodys_matcher:lazy")
    assert match(SCAN, SCAN, GUESS, config.frontend.method) == NoMatch("no time")
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
        named(name)


def test_ours_are_known() -> None:
    assert [named(name) for name in ("wsm", "icp", "plicp")] == ["wsm", "icp", "plicp"]
    assert isinstance(match(Reference(SCAN), SCAN, np.zeros(3), "icp"), Match)
