"""A known field bends a map, and the study scores what is found of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scenarios.ablate.smooth_field import SmoothField, bend_map
from scenarios.ablate.study import bends
from slam import se2
from tests.scenarios.ablate.tiny_pair import tiny_pair


def test_a_field_displaces_by_no_more_than_it_says_and_smoothly() -> None:
    field = SmoothField.draw(0.6, np.random.default_rng(0))
    points = np.random.default_rng(1).uniform(-30.0, 30.0, (2000, 2))
    off = field.undone(points) - points
    assert field.reach == pytest.approx(0.6)
    assert 0.2 < np.abs(off).max() <= 0.6 + 1e-9
    near = field.undone(points + np.array([0.1, 0.0])) - field.undone(points)
    assert np.abs(near - [0.1, 0.0]).max() < 0.1 * 0.6 * 2.0 * np.pi / 15.0 + 1e-3


def test_walls_of_a_bent_map_were_where_the_field_says() -> None:
    whole = tiny_pair().b
    field = SmoothField.draw(0.5, np.random.default_rng(0))
    bent = bend_map(whole, field)
    back = field.undone(bent.grid.occupied_points())
    distance, _ = cKDTree(whole.grid.occupied_points()).query(back)
    assert distance.max() < 0.08
    assert bent.grid.free.sum() == pytest.approx(whole.grid.free.sum(), rel=0.1)


def test_a_pair_is_scored_by_where_its_shared_walls_are_put() -> None:
    pair = tiny_pair()
    result = bends.join(pair, 0.0, np.random.default_rng(0))
    assert result.bin == "50 %"
    assert np.isfinite(result.rigid_m)
    still = SmoothField.draw(0.0, np.random.default_rng(0))
    truth = se2.transform(pair.T_a_b, still.undone(pair.b.points.points))
    assert bends._miss(truth + np.array([0.3, 0.4]), truth) == pytest.approx(0.5)


def test_buildings_of_one_plan_are_no_strangers() -> None:
    pair = tiny_pair()
    names = ("hospital", "two_drives", "office_smoke", "hospital")
    couples = list(bends._of_different_plans([replace(pair, scenario=name) for name in names]))
    assert len(couples) == 4
    for one, other in couples:
        assert (one.scenario == "hospital") != (other.scenario == "hospital")


def test_the_table_counts_wrong_ones_of_those_accepted() -> None:
    def result(accepted: bool, rigid: float) -> bends.BendResult:
        return bends.BendResult("hospital", 0, "30 %", 0.3, accepted, True, rigid, 0.1, 1.0)

    table = bends.summary([result(True, 0.2), result(True, 3.0), result(False, 0.4), result(False, np.nan)])
    assert [str(cell) for cell in table.rows[0][:6]] == ["30 %", "0.3", "4", "2", "2", "1/2"]
