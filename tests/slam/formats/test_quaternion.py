"""Quaternions against rotation matrices multiplied by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.formats import quaternion

HALF = st.floats(-1.5, 1.5)
FULL = st.floats(-3.1, 3.1)


def product(roll: float, pitch: float, yaw: float) -> np.ndarray:
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    around_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    around_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    around_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return around_z @ around_y @ around_x


@given(FULL, HALF, FULL, st.floats(0.1, 10.0))
def test_angles_come_back_whatever_the_length(roll: float, pitch: float, yaw: float, length: float) -> None:
    q = [length * part for part in quaternion.from_angles(roll, pitch, yaw)]
    np.testing.assert_allclose(quaternion.matrix(*q), product(roll, pitch, yaw), atol=1e-9)
    assert quaternion.roll_pitch(*q) == pytest.approx((roll, pitch), abs=1e-6)
    assert quaternion.yaw_of(*q) == pytest.approx(yaw, abs=1e-6)


def test_a_quarter_turn_to_the_left() -> None:
    assert quaternion.from_angles(0.0, 0.0, np.pi / 2) == pytest.approx((0.5**0.5, 0, 0, 0.5**0.5))
