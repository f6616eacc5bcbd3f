"""A keyframe and its neighbours: who they are, and what matching them says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slam import se2
from slam.matching import Reference
from slam.scan import Scan
from slam.se2 import Array
from stitch.mapping.bundle import BundleConfig, match_keyframe, partners
from stitch.mapping.config import OnlineConfig

Look = Callable[..., Scan]
FEW = BundleConfig(neighbours=4, per_pass=2, reach=1.0)
ONLINE = OnlineConfig()
CONFIG, LIMIT = BundleConfig(radii=ONLINE.radii), (ONLINE.max_shift, ONLINE.max_turn)


def test_partners_are_earlier_near_allowed_and_of_several_passes() -> None:
    x = [0.0, 0.5, 9.0, 9.0, 0.6, 0.8, 1.0, 0.7, 0.9]
    poses = np.column_stack([x, np.zeros((9, 2))])
    allowed = np.ones(9, dtype=bool)
    assert set(partners(poses, 8, allowed, FEW)) <= {0, 1, 4, 5, 6, 7}
    assert len(partners(poses, 8, allowed, FEW)) == 4  # two of either pass
    allowed[4:8] = False
    np.testing.assert_array_equal(partners(poses, 8, allowed, FEW), [0, 1])
    np.testing.assert_array_equal(partners(poses, 0, allowed, FEW), [])


def test_matches_find_the_true_relative_poses(room: Array, look: Look) -> None:
    at = np.array([[2.0, 3.2, 0.0], [2.3, 3.2, 0.1], [2.6, 3.3, 0.0]])
    scans = [Reference(look(room, pose, np.random.default_rng(k))) for k, pose in enumerate(at)]
    true = se2.between(at[:2], at[2])
    guesses = true + np.array([0.05, -0.05, 0.03])
    known, T_ij, information = match_keyframe(scans[:2], scans[2], guesses, CONFIG, LIMIT)
    assert known.tolist() == [True, True]
    np.testing.assert_allclose(T_ij, true, atol=0.01)
    assert np.all(np.linalg.eigvalsh(information)[:, 0] > 0.0)


def test_a_match_far_from_its_guess_and_one_that_sees_nothing_are_left_out(room: Array, look: Look) -> None:
    seen = Reference(look(room, np.array([2.0, 3.2, 0.0])))
    blind = Reference(seen.scan.selected(np.zeros(len(seen), dtype=bool)))
    guesses = np.zeros((2, 3))
    known, T_ij, _ = match_keyframe([blind, seen], seen, guesses, CONFIG, LIMIT)
    assert (known.tolist(), len(T_ij)) == ([False, True], 1)
    off = np.array([[0.8 * LIMIT[0], 0.6 * LIMIT[0], np.radians(8.0)]])
    assert not match_keyframe([seen], seen, off, CONFIG, LIMIT)[0].any()
