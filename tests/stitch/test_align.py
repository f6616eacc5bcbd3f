"""Two submaps of one building come together; two of different buildings do not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.matching import MatchConfig
from stitch import NoStitch, Prior, Stitch, align
from stitch.align import AlignConfig
from stitch.alignment.config import Acceptance, PriorConfig, RefinementConfig
from stitch.alignment.joint import search
from stitch.alignment.raster import walls_of
from stitch.published.htms import dominant_direction
from stitch.published.pair import Pair

CORRELATION = AlignConfig(refinement=RefinementConfig(enabled=False))
ANYTHING = Acceptance(
    min_overlap=0.0,
    min_open=0.0,
    min_lead=-np.inf,
    max_ambiguity=np.inf,
    equal_walls=np.inf,
    min_belief=-np.inf,
)
NEVER_AMBIGUOUS = Acceptance(min_lead=0.0, max_ambiguity=1.0, equal_walls=np.inf)
CREDULOUS = replace(CORRELATION, acceptance=ANYTHING, prior=PriorConfig(confidence=1.0))
HTMS = AlignConfig(method="htms")
COVARIANCE = np.diag([0.5, 0.5, 0.05]) ** 2


def error(T_true: np.ndarray, T: np.ndarray) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    xi = se2.log(se2.between(T_true, T))
    return float(np.hypot(xi[0], xi[1])), abs(float(xi[2]))


@pytest.fixture(scope="module")
def near(plan: dict[str, Any]) -> tuple[Submap, Submap, np.ndarray]:
    return plan["pair"](0, 8.0)


@pytest.fixture(scope="module")
def strangers(plan: dict[str, Any]) -> tuple[Submap, Submap]:
    return plan["pair"](1, 8.0)[0], plan["pair"](2, 8.0)[1]


def refused_though_believed(a: Submap, b: Submap) -> str:
    """Why maps are not joined, also where the best alignment alone has odds enough."""
    answer = align(a, b, config=CORRELATION)
    assert isinstance(answer, NoStitch)
    assert answer.best is not None
    credulous = Acceptance(min_belief=-np.inf)
    answer = align(a, b, config=replace(CORRELATION, acceptance=credulous))
    assert isinstance(answer, NoStitch)
    return answer.reason


def shifted(submap: Submap, T: np.ndarray) -> Submap:
    """The same map in another frame, not turned; T is the new frame in the old one."""
    back = se2.inverse(T)
    grid = replace(submap.grid, origin=submap.grid.origin + back[:2])
    return replace(submap, points=submap.points.transformed(back), grid=grid)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("overlap", [4.0, 12.0])
def test_known_poses_are_recovered_without_a_guess(plan: dict[str, Any], seed: int, overlap: float) -> None:
    a, b, T_true = plan["pair"](seed, overlap)
    climbed, answer = align(a, b, config=CORRELATION), align(a, b)
    assert isinstance(climbed, Stitch), climbed
    assert isinstance(answer, Stitch), answer
    distance, angle = error(T_true, climbed.T_a_b)
    assert distance < 0.08
    assert angle < np.radians(0.4)
    distance, angle = error(T_true, answer.T_a_b)
    assert distance < 0.004
    assert angle < np.radians(0.03)
    assert climbed.agreement > 0.9
    assert climbed.overlap_area > 40.0


def test_the_matcher_sharpens_the_answer(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    coarse, fine = align(a, b, config=CORRELATION), align(a, b)
    assert isinstance(coarse, Stitch)
    assert isinstance(fine, Stitch)
    assert error(T_true, fine.T_a_b)[0] < min(0.003, error(T_true, coarse.T_a_b)[0])
    added = np.linalg.eigvalsh(fine.covariance - coarse.covariance)
    assert np.all(added > 0.0)


def test_both_ways_round(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    answer = align(b, a)
    assert isinstance(answer, Stitch)
    assert error(se2.inverse(T_true), answer.T_a_b)[0] < 0.005


def test_origins_enter_the_translation(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    T = np.array([3.7, -12.3, 0.0])
    answer = align(shifted(a, T), b, config=CORRELATION)
    assert isinstance(answer, Stitch)
    assert error(se2.compose(se2.inverse(T), T_true), answer.T_a_b)[0] < 0.06


def test_a_prior_narrows_the_search(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    guess = se2.compose(T_true, [0.6, -0.4, 0.06])
    answer = align(a, b, Prior(guess, COVARIANCE), CORRELATION)
    assert isinstance(answer, Stitch)
    assert error(T_true, answer.T_a_b)[0] < 0.06
    for alternative in answer.alternatives:
        assert np.all(np.abs(se2.between(guess, alternative.T_a_b)[:2]) < 3.5)


def test_a_wrong_prior_is_refused(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    answer = align(a, b, Prior(se2.compose(T_true, [0.0, 6.0, 0.0]), COVARIANCE), CORRELATION)
    assert isinstance(answer, NoStitch)
    assert answer.reason


def test_a_prior_beyond_the_maps_is_refused(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    answer = align(a, b, Prior(T_true + np.array([500.0, 0.0, 0.0]), COVARIANCE), CORRELATION)
    assert isinstance(answer, NoStitch)
    assert "touch" in answer.reason
    assert answer.best is None


def test_the_prior_decides_between_equals(plan: dict[str, Any]) -> None:
    """A bare square room looks the same after a quarter turn: a guess of the yaw makes it certain."""
    rng = np.random.default_rng(3)
    room = np.array(plan["box"](0.0, 0.0, 6.0, 6.0))
    poses = np.column_stack([rng.uniform(1.0, 5.0, (20, 2)), rng.uniform(-3.0, 3.0, 20)])
    anchors = np.array([[2.0, 3.0, 0.1], [4.0, 2.5, 1.4]])
    a, b = (plan["see"](room, poses, anchor, rng) for anchor in anchors)
    T_true = se2.between(anchors[0], anchors[1])
    assert "ambiguity" in refused_though_believed(a, b)
    told = align(a, b, Prior(T_true, np.diag([1.0, 1.0, 0.1]) ** 2), CORRELATION)
    assert isinstance(told, Stitch)
    assert error(T_true, told.T_a_b)[0] < 0.06


def test_different_buildings_are_refused(strangers: tuple[Submap, Submap]) -> None:
    answer = align(*strangers, config=CORRELATION)
    assert isinstance(answer, NoStitch)
    assert answer.reason
    assert answer.best is not None


def test_parts_that_never_meet_are_refused(plan: dict[str, Any]) -> None:
    a, b, _ = plan["pair"](4, -14.0)
    assert isinstance(align(a, b, config=CORRELATION), NoStitch)


def test_thresholds_are_obeyed(
    near: tuple[Submap, Submap, np.ndarray], strangers: tuple[Submap, Submap]
) -> None:
    strict = replace(CORRELATION, acceptance=Acceptance(min_overlap=1000.0))
    refused = align(near[0], near[1], config=strict)
    assert isinstance(refused, NoStitch)
    assert refused.best is not None
    assert isinstance(align(*strangers, config=CREDULOUS), Stitch)


def test_a_rival_as_clean_is_ambiguous(plan: dict[str, Any]) -> None:
    """Two rooms alike but for their size of overlap: the larger one is no more likely for that."""
    rng = np.random.default_rng(5)
    walls = [plan["box"](x, 0.0, x + 4.0, 4.0) for x in (0.0, 4.0, 8.0)]
    rooms = np.array([side for room in walls for side in room])
    whole = np.column_stack([rng.uniform(0.5, 3.5, (30, 2)), rng.uniform(-3.0, 3.0, 30)])
    everywhere = np.concatenate([whole + np.array([4.0 * k, 0.0, 0.0]) for k in range(3)])
    a, b = (
        plan["see"](rooms, everywhere, np.array([1.0, 2.0, 0.0]), rng),
        plan["see"](rooms, whole + np.array([4.0, 0.0, 0.0]), np.array([5.0, 2.0, 0.4]), rng),
    )
    assert "ambiguity" in refused_though_believed(a, b)


@pytest.mark.parametrize("method", ["joint", "htms"])
@pytest.mark.parametrize("empty", ["a", "b"])
def test_an_empty_map_has_a_reason(
    near: tuple[Submap, Submap, np.ndarray], plan: dict[str, Any], method: str, empty: str
) -> None:
    blank = np.zeros((4, 4), dtype=bool)
    nothing = Submap(
        0, 1, np.zeros(3), plan["scan_of"](np.zeros((0, 2))), Grid(blank, blank, np.zeros(2), 0.05)
    )
    maps = (nothing, near[1]) if empty == "a" else (near[0], nothing)
    answer = align(*maps, config=AlignConfig(method=method))
    assert isinstance(answer, NoStitch)
    assert f"submap {empty}" in answer.reason
    assert answer.best is None


def refined_by(**settings: object) -> AlignConfig:
    return AlignConfig(refinement=replace(AlignConfig().refinement, **settings))


def test_without_an_answer_of_the_matcher_the_climb_stands(near: tuple[Submap, Submap, np.ndarray]) -> None:
    demanding = refined_by(matcher=MatchConfig(least_pairs=1_000_000))
    answer, climbed = align(near[0], near[1], config=demanding), align(near[0], near[1], config=CORRELATION)
    assert isinstance(answer, Stitch)
    assert isinstance(climbed, Stitch)
    np.testing.assert_array_equal(answer.T_a_b, climbed.T_a_b)
    np.testing.assert_array_equal(answer.covariance, climbed.covariance)


@pytest.mark.parametrize("limit", [(1e-6, 1.0), (1.0, 1e-8)])
def test_a_matcher_that_wanders_off_is_not_believed(
    near: tuple[Submap, Submap, np.ndarray], limit: tuple[float, float]
) -> None:
    answer = align(near[0], near[1], config=refined_by(max_correction=limit))
    assert isinstance(answer, NoStitch)
    assert "left the peak" in answer.reason


def test_a_bare_corridor_is_ambiguous_and_its_covariance_wide(plan: dict[str, Any]) -> None:
    """Two walls and a guess: refused; if it must be taken, sure across and unsure along, in the axes of b."""
    rng = np.random.default_rng(6)
    walls = np.array([[-40.0, 0.0, 40.0, 0.0], [-40.0, 2.0, 40.0, 2.0]])
    poses = np.column_stack([np.linspace(-3.0, 3.0, 20), np.full(20, 1.0), rng.uniform(-3.0, 3.0, 20)])
    anchors = np.array([[0.0, 1.0, 0.3], [1.0, 1.0, 0.3 + np.pi / 2]])
    a, b = (plan["see"](walls, poses, anchor, rng) for anchor in anchors)
    T_true = se2.between(anchors[0], anchors[1])
    prior = Prior(T_true, np.diag([0.4, 0.4, 0.03]) ** 2)
    refused = align(a, b, prior)
    assert isinstance(refused, NoStitch)
    assert "ambiguity" in refused.reason
    answer = align(a, b, prior, AlignConfig(acceptance=NEVER_AMBIGUOUS))
    assert isinstance(answer, Stitch)
    R = se2.rotation(anchors[1, 2])  # from b's axes to the building's
    spread = R @ answer.covariance[:2, :2] @ R.T
    assert np.sqrt(spread[1, 1]) < 0.06
    assert np.sqrt(spread[0, 0]) > 4.0 * np.sqrt(spread[1, 1])


def test_covariance_is_symmetric_and_positive(near: tuple[Submap, Submap, np.ndarray]) -> None:
    answer = align(near[0], near[1])
    assert isinstance(answer, Stitch)
    np.testing.assert_array_equal(answer.covariance, answer.covariance.T)
    assert np.linalg.eigvalsh(answer.covariance)[0] > 1e-6


def test_a_map_without_straight_lines_is_found_around_the_prior_and_alone(plan: dict[str, Any]) -> None:
    a, b, T_true = plan["stones"]()
    guess = se2.compose(T_true, [0.3, 0.3, np.radians(7.0)])
    for prior in (Prior(guess, np.diag([0.5, 0.5, np.radians(5.0)]) ** 2), None):
        answer = align(a, b, prior, CORRELATION)
        assert isinstance(answer, Stitch), answer
        assert error(T_true, answer.T_a_b)[0] < 0.06


def test_htms_needs_a_large_overlap_and_never_refuses(
    plan: dict[str, Any], strangers: tuple[Submap, Submap]
) -> None:
    """The thesis's finding: rotation right, translation right only where the maps overlap much."""
    a, b, T_true = plan["pair"](5, 24.0)
    told = Prior(np.array([0.0, 0.0, T_true[2] + 0.2]), COVARIANCE)  # its translation is not read
    answer = align(a, b, told, HTMS)
    assert isinstance(answer, Stitch)
    distance, angle = error(T_true, answer.T_a_b)
    assert distance < 0.3
    assert angle < np.radians(1.0)
    assert answer.covariance is None
    assert isinstance(align(*strangers, config=HTMS), Stitch)


def test_htms_takes_the_smallest_rotation_of_four(plan: dict[str, Any]) -> None:
    """The thesis's section 4.3; the four hypotheses of its figure 3.11 are all returned."""
    a, b, _ = plan["pair"](5, 24.0)
    alone = align(a, b, config=HTMS)
    assert isinstance(alone, Stitch)
    turns = np.abs([alone.T_a_b[2], *(other.T_a_b[2] for other in alone.alternatives)])
    assert len(turns) == 4
    assert turns[0] == turns.min()
    turned = align(a, b, Prior(np.array([0.0, 0.0, alone.T_a_b[2] + np.pi]), COVARIANCE), HTMS)
    assert isinstance(turned, Stitch)
    assert abs(abs(float(se2.wrap(turned.T_a_b[2] - alone.T_a_b[2]))) - np.pi) < 1e-9


def test_the_dominant_direction_is_that_of_the_walls(near: tuple[Submap, Submap, np.ndarray]) -> None:
    """htms correlates along it: the building's axes, in the frame of the map."""
    maps = Pair(near[0], near[1], HTMS)
    direction = dominant_direction(maps.spectra(180, split=False)[0])
    off = np.sin(2.0 * (direction + near[0].anchor[2]))
    assert off == pytest.approx(0.0, abs=0.03)


def test_the_search_loses_what_the_prior_says(near: tuple[Submap, Submap, np.ndarray]) -> None:
    a, b, T_true = near
    maps = walls_of(a, 0.1), walls_of(b, 0.1)
    prior = Prior(se2.compose(T_true, [0.8, 0.0, 0.0]), COVARIANCE)
    free, held = (
        search(*maps, T_true[2:], prior, replace(CORRELATION, prior=PriorConfig(weight=weight)))[0]
        for weight in (0.0, 20.0)
    )
    np.testing.assert_allclose(held.T_a_b, free.T_a_b)
    assert free.score - held.score == pytest.approx(10.0 * prior.distance(free.T_a_b), rel=1e-4)


def test_same_input_same_output(near: tuple[Submap, Submap, np.ndarray]) -> None:
    first, second = align(near[0], near[1]), align(near[0], near[1])
    assert isinstance(first, Stitch)
    assert isinstance(second, Stitch)
    np.testing.assert_array_equal(first.T_a_b, second.T_a_b)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_settings_are_checked() -> None:
    with pytest.raises(ValueError, match="method"):
        AlignConfig(method="magic")
    with pytest.raises(ValueError, match="resolution"):
        AlignConfig(resolution=0.0)
    with pytest.raises(ValueError, match="positive definite"):
        Prior(np.zeros(3), np.zeros((3, 3)))
    with pytest.raises(ValueError, match="finite pose"):
        Prior(np.array([0.0, np.nan, 0.0]), np.eye(3))
