"""Do the matcher's covariances tell the truth? Monte Carlo in a room and in a bare corridor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from slam import se2
from slam.matching import Match, MatchConfig, match
from slam.scan import Scan
from slam.se2 import Array

FROM = np.array([2.0, 2.5, 0.3])
SEED_ERROR = np.array([0.03, -0.03, np.radians(1.1)])
ONE_LEVEL = MatchConfig(levels=((0.5, 1),), most_iterations=80, search_shift=0.0)

Look = Callable[..., Scan]


def found(*arguments: object, **settings: object) -> Match:
    result = match(*arguments, **settings)  # type: ignore[arg-type]
    assert isinstance(result, Match), result
    return result


@dataclass(frozen=True)
class Trials:
    """Errors ``(M, 3)`` and predicted covariances ``(M, 3, 3)``, both in the body frame of the scan."""

    errors: Array
    covariances: Array

    def nees(self) -> float:
        """Sum of the squared normalised errors, χ² of 3 M degrees of freedom if honest."""
        return float(np.sum(self.errors * np.linalg.solve(self.covariances, self.errors[..., None])[..., 0]))

    @property
    def sd(self) -> Array:
        """Median predicted standard deviations ``(3,)``."""
        return np.sqrt(np.median(np.diagonal(self.covariances, axis1=1, axis2=2), axis=0))


def trials(look: Look, walls: Array, start: Array, method: str, covariance: str, count: int = 150) -> Trials:
    """Matches of scans from random places near ``start``, seeded 3 cm and 1.1° off the truth."""
    rng = np.random.default_rng(5)
    errors, covariances = [], []
    for _ in range(count):
        pose = start + rng.uniform(-0.3, 0.3, 3) * [1.0, 1.0, 0.3]
        T = rng.uniform(-1.0, 1.0, 3) * [0.2, 0.0, 0.08] + [0.1, 0.0, 0.0]
        reference, scan = look(walls, pose, rng), look(walls, se2.compose(pose, T), rng)
        guess = T + rng.normal(size=3) * np.abs(SEED_ERROR)
        config = replace(ONE_LEVEL, robust=1e12 if method == "icp" else 9.0, mutual=method != "plicp")
        result = found(reference, scan, guess, method, covariance, config=config)
        errors.append(se2.log(se2.between(result.T_reference_scan, T)))
        covariances.append(result.covariance)
    return Trials(np.array(errors), np.array(covariances))


def assert_honest(squared: float, degrees: int) -> None:
    """A sum of squared normalised errors lies in the 95 % band of χ²."""
    low, high = chi2.ppf([0.025, 0.975], degrees)
    assert low <= squared <= high


@pytest.mark.parametrize(
    ("method", "covariance"), [("wsm", "joint"), ("wsm", "p2l"), ("plicp", "p2l"), ("plicp", "joint")]
)
def test_in_a_room_weighted_covariances_are_honest(
    room: Array, look: Look, method: str, covariance: str
) -> None:
    result = trials(look, room, FROM, method, covariance)
    rms = np.sqrt(np.mean(result.errors**2, axis=0))
    assert np.all(rms < [0.0030, 0.0030, 0.0010])
    assert_honest(result.nees(), 3 * len(result.errors))
    for axis in range(3):
        assert_honest(np.sum((result.errors[:, axis] / result.sd[axis]) ** 2), len(result.errors))


def test_in_a_room_unweighted_icp_is_overconfident(room: Array, look: Look) -> None:
    result = trials(look, room, FROM, "icp", "joint", count=80)
    assert result.nees() > 10.0 * chi2.ppf(0.975, result.errors.size)
    assert np.sqrt(np.mean(result.errors[:, :2] ** 2)) > 0.006


def test_in_a_corridor_only_walls_normals_tell_that_the_way_along_is_unknown(
    corridor: Array, look: Look
) -> None:
    joint = trials(look, corridor, np.zeros(3), "wsm", "joint", count=80)
    honest = trials(look, corridor, np.zeros(3), "wsm", "p2l", count=80)
    np.testing.assert_array_equal(joint.errors, honest.errors)
    along = np.sqrt(np.mean(joint.errors[:, 0] ** 2))
    assert along > 0.02
    assert joint.sd[0] < 0.2 * along
    assert joint.nees() > 20.0 * chi2.ppf(0.975, joint.errors.size)
    assert honest.sd[0] >= 0.3
    assert honest.sd[2] < 0.003
    assert honest.nees() <= chi2.ppf(0.975, honest.errors.size)  # more careful than it need be


def test_the_unknown_direction_is_one_of_the_body(corridor: Array, look: Look) -> None:
    around = np.radians(np.arange(-180.0, 180.0, 2.0))
    rng = np.random.default_rng(6)
    reference, along = (look(corridor, np.array([x, 0.0, 0.0]), rng, around) for x in (0.0, 0.05))
    across = look(corridor, np.array([0.05, 0.0, np.pi / 2]), rng, around)
    sd = {
        name: np.sqrt(np.diag(found(reference, scan, np.array([0.05, 0.0, yaw]), "wsm", "p2l").covariance))
        for name, scan, yaw in (("along", along, 0.0), ("across", across, np.pi / 2))
    }
    assert sd["along"][0] > 0.3 > 0.05 > sd["along"][1]
    assert sd["across"][1] > 0.3 > 0.05 > sd["across"][0]
