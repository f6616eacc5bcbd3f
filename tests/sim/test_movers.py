"""Debris and people: what they are, and how people walk."""

from __future__ import annotations

import numpy as np
import pytest

from sim.floorplan import Prism, box
from sim.physics import Walker
from sim.world import Debris, Person

FAR = (1e3, 1e3)
SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])


def walked(person, seconds, robot=FAR, dt=0.01):
    walker = Walker(person)
    for _ in range(round(seconds / dt)):
        walker.step(robot, dt)
    return walker


@pytest.mark.parametrize(
    ("seconds", "place", "heading"),
    [(0.5, (0.5, 0.0), 0.0), (2.5, (2.0, 0.5), 90.0), (4.0, (1.0, 1.0), 180.0), (6.5, (0.5, 0.0), 0.0)],
)
def test_a_person_goes_round_the_loop(seconds, place, heading):
    walker = walked(Person(SQUARE, speed=1.0), seconds)
    assert walker.place == pytest.approx(place, abs=1e-9)
    assert np.rad2deg(walker.heading) == pytest.approx(heading)


def test_the_start_is_a_share_of_the_loop():
    assert Walker(Person(SQUARE, start=0.5)).place == pytest.approx((2.0, 1.0))
    assert Walker(Person(SQUARE, start=1.25)).place == pytest.approx((1.5, 0.0))


def test_two_points_make_a_way_there_and_back():
    assert walked(Person(np.array([[0.0, 0.0], [3.0, 0.0]])), 4.0).place == pytest.approx((2.0, 0.0))


def test_a_person_turns_round_before_the_robot():
    walker, nearest = Walker(Person(SQUARE, keep_off=0.6)), np.inf
    for _ in range(400):
        walker.step((1.5, 0.0), 0.01)
        nearest = min(nearest, np.hypot(walker.place[0] - 1.5, walker.place[1]))
    assert 0.58 < nearest < 0.61
    assert walker.place[1] > 0.0  # has turned round


def test_a_person_with_nowhere_to_go_stands():
    """At the end of a line where he would turn round, but the robot has come up on it."""
    walker = walked(Person(np.array([[0.0, 0.0], [3.0, 0.0]]), start=0.5), 1.0, robot=(2.6, 0.0))
    assert walker.place == pytest.approx((3.0, 0.0))


def test_debris_lies_with_its_centre_of_mass_in_the_origin():
    triangle = Debris(Prism(np.array([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]]), 0.0, 0.5), 2.0)
    np.testing.assert_allclose(triangle.centre, [2.0, 2.0])
    np.testing.assert_allclose(triangle.shape.footprint, [[-1, -1], [2, -1], [-1, 2]])
    np.testing.assert_allclose(Debris(box([3, 4, 0.7], 1.0, 0.5), 2.0).centre, [3.0, 4.0])
    assert (triangle.shape.z_lo, triangle.shape.z_hi) == (0.0, 0.5)


def test_a_person_is_as_wide_and_tall_as_asked():
    shape = Person(SQUARE, radius=0.25, height=1.6).shape
    np.testing.assert_allclose(np.hypot(*shape.footprint.T), 0.25)
    assert shape.z_hi == 1.6


@pytest.mark.parametrize(
    "make",
    [
        lambda: Debris(box([0, 0, 0], 1, 1), 0.0),
        lambda: Debris(box([0, 0, 0], 1, 1), 1.0, -0.1),
        lambda: Person(np.zeros((1, 2))),
        lambda: Person(np.zeros((3, 2))),
        lambda: Person(SQUARE, speed=-1.0),
        lambda: Person(SQUARE, radius=0.0),
    ],
)
def test_impossible_movers_are_refused(make):
    with pytest.raises(ValueError, match=r"debris|person"):
        make()
