"""Maps that may be bent: joined where they are of one house, with a covariance; refused where not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from slam.mapping.submap import Submap
from stitch.align import AlignConfig, NoStitch, Prior, Stitch, align
from stitch.alignment.bend import Bend
from stitch.alignment.config import Acceptance, TolerantConfig
from stitch.alignment.facing import facing_walls
from stitch.alignment.judgement import judge
from stitch.alignment.tolerant import bend_stitch, covariance, scaled
from tests.stitch.alignment import bent_rooms

BENT = AlignConfig(tolerant=TolerantConfig(enabled=True))


def fitted(b: Submap) -> np.ndarray:
    """The rigid pose nearest to where b's shared walls truly lie."""
    points = b.points.points
    truth = bent_rooms.true_places(points)
    shared = truth[:, 0] < 20.0
    return se2.fit_rigid(points[shared], truth[shared])


def test_a_bent_map_is_joined_bent() -> None:
    a, b = bent_rooms.pair()
    assert isinstance(align(a, b), NoStitch)
    stitch = align(a, b, None, BENT)
    assert isinstance(stitch, Stitch)
    assert stitch.bend is not None
    assert stitch.covariance is not None
    xi = se2.log(se2.between(fitted(b), stitch.T_a_b))
    assert np.hypot(*xi[:2]) < 0.5
    assert xi @ np.linalg.solve(stitch.covariance, xi) < se2.max_distance(0.999)
    assert 0.3 < stitch.bend.largest_displacement(stitch.T_a_b) < 1.5
    assert len(stitch.alternatives) <= 4


def test_strangers_are_refused_with_their_best_candidates() -> None:
    result = align(*bent_rooms.strangers(), None, BENT)
    assert isinstance(result, NoStitch)
    assert "as bent maps: " in result.reason
    assert result.best is not None
    assert result.best.belief is not None
    assert result.best.belief < 0.0
    assert result.alternatives


def test_what_joint_believes_stands_unchanged(plan: dict) -> None:  # type: ignore[type-arg]
    a, b, _ = plan["pair"](5, 24.0)
    plain, tolerant = align(a, b), align(a, b, None, BENT)
    assert isinstance(plain, Stitch)
    assert isinstance(tolerant, Stitch)
    assert tolerant.bend is None
    np.testing.assert_array_equal(plain.T_a_b, tolerant.T_a_b)


def test_a_free_scale_is_found_and_never_used_unasked() -> None:
    a, b = bent_rooms.pair()
    smaller = scaled(b, 1.0 / 1.1)
    few = replace(BENT.tolerant, free_scale=True, candidates=8, max_ambiguity=0.9)
    free = replace(BENT, tolerant=few)
    stitch = align(a, smaller, None, free)
    assert isinstance(stitch, Stitch)
    assert stitch.scale == pytest.approx(1.1, abs=0.015)
    fixed = align(a, smaller, None, BENT)
    assert (fixed if isinstance(fixed, Stitch) else fixed.best).scale == 1.0  # type: ignore[union-attr]


def test_maps_of_walls_only_are_refused_as_nothing_could_speak_against() -> None:
    a, b = (
        replace(one, grid=replace(one.grid, free=np.zeros_like(one.grid.free))) for one in bent_rooms.pair()
    )
    result = align(a, b, None, BENT)
    assert isinstance(result, NoStitch)
    assert "as bent maps" not in result.reason


@pytest.mark.parametrize(("off", "joined"), [(0.3, True), (30.0, False)])
def test_a_prior_is_obeyed(off: float, joined: bool) -> None:
    prior = Prior(se2.compose(bent_rooms.T_A_B, [off, 0.0, 0.0]), np.diag([1.0, 1.0, 0.03]))
    result = align(*bent_rooms.pair(), prior, BENT)
    assert isinstance(result, Stitch) == joined


def test_a_rigid_stitch_is_bent_on_demand() -> None:
    a, b = bent_rooms.pair()
    rigid = Stitch(fitted(b), None, 1.0, 1.0, 1.0)
    stitch = bend_stitch(a, b, rigid, BENT)
    assert isinstance(stitch, Stitch)
    assert stitch.bend is not None
    np.testing.assert_array_equal(stitch.T_a_b, rigid.T_a_b)


def test_a_map_agrees_with_itself_and_contradicts_itself_when_moved() -> None:
    config = TolerantConfig()
    walls = facing_walls(bent_rooms.pair()[0], config.unknown_weight)
    same = judge(walls, walls, Bend.rigid(walls, np.zeros(3), 4.0), 1.0, config)
    moved = judge(walls, walls, Bend.rigid(walls, np.array([1.0, 1.0, 0.0]), 4.0), 1.0, config)
    assert same.conflict == 0.0
    assert same.agreement == pytest.approx(2.0 * walls.weights.sum(), rel=0.05)
    assert same.share == 1.0
    assert moved.score < 0.5 * same.score
    assert moved.conflict > 0.2 * same.agreement
    np.testing.assert_allclose(same.T_a_b, 0.0, atol=1e-9)


def test_belief_is_the_margin_beyond_the_least_that_is_accepted() -> None:
    stitch = align(*bent_rooms.pair(), None, BENT)
    assert isinstance(stitch, Stitch)
    assert stitch.belief is not None
    assert stitch.belief >= 0.0
    margin = BENT.tolerant.min_margin + BENT.tolerant.belief_scale * stitch.belief
    for least, joined in ((margin - 0.01, True), (margin + 0.01, False)):
        config = replace(BENT, tolerant=replace(BENT.tolerant, min_margin=least))
        assert isinstance(align(*bent_rooms.pair(), None, config), Stitch) == joined


def test_nothing_that_agrees_gives_no_covariance() -> None:
    config = TolerantConfig()
    walls = facing_walls(bent_rooms.pair()[0], config.unknown_weight)
    far = judge(walls, walls, Bend.rigid(walls, np.array([200.0, 0.0, 0.0]), 4.0), 1.0, config)
    assert covariance(far, config) is None


def test_maps_that_share_little_free_space_are_refused() -> None:
    strict = replace(BENT, acceptance=Acceptance(min_open=1e4))
    result = align(*bent_rooms.pair(), None, strict)
    assert isinstance(result, NoStitch)
    assert "space free in both" in result.reason
