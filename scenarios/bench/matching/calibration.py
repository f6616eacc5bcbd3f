"""Is a covariance what the errors are? Monte Carlo in a room, and in a corridor that is the same all along.

181 beams over 180°, σ 0.01 m; the robot looks along x from one place and is then up to 0.2 m along each
axis and 10° from there; guesses are off by 3 cm and 1.1° (standard deviations).

And how near are the errors to the Cramér–Rao bound? Censi, "On achievable accuracy for range-finder
localization" (2007): a beam from p along u that meets a straight wall of normal n has ∂r/∂p = −n / (n·u) and
∂r/∂yaw = −r (n·Ju) / (n·u); Fisher's information is the sum of gᵀg / σ². The walls are known there; here they
are known from another scan as noisy as this one: 2 σ².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scenarios.bench.matching.matchers import DEFAULT, Variant
from scenarios.bench.matching.pairs import APART, Pair, look
from scenarios.bench.matching.scores import match_all, matches_and_errors
from sim.laser import Raycaster
from slam import se2
from slam.matching import RAW_WSM
from slam.se2 import Array

ROOM = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]], dtype=float)
CORRIDOR = np.array([[-60, -1.2, 60, -1.2], [-60, 1.2, 60, 1.2]])
"""Walls ``(S, 4)`` m; the ends of the corridor are out of reach."""
PLACES = {"room": (ROOM, np.array([2.2, 1.7, 0.0])), "corridor": (CORRIDOR, np.zeros(3))}
"""Walls, and where the first scan is taken."""
GUESS_SIGMA = np.array([0.03, 0.03, np.radians(1.1)])
PAIRS = 150
SAME_SPOT = 1e-6
"""Ranges [m] nearer than this meet the same spot."""

PLAIN = replace(DEFAULT, search_shift=0.0)
"""The default without its searches, whose answers widen a covariance."""
MODES = (
    Variant("icp, joint", "icp", "joint"),
    Variant("raw wsm, pfister_block", "wsm", "pfister_block", RAW_WSM),
    Variant("wsm without search, pfister_block", "wsm", "pfister_block", PLAIN),
    Variant("wsm without search, joint", "wsm", "joint", PLAIN),
    Variant("wsm without search, p2l", "wsm", "p2l", PLAIN),
    Variant("plicp, pfister_block", "plicp", "pfister_block"),
    Variant("plicp, joint", "plicp", "joint"),
    Variant("plicp, p2l", "plicp", "p2l"),
)


@dataclass(frozen=True)
class Trials:
    """Matches of pairs from one place: ``errors (N, 3)`` and ``covariances (N, 3, 3)`` about the second pose,
    along the world's axes."""

    errors: Array
    covariances: Array

    @property
    def rms(self) -> Array:
        """Root mean square errors ``(3,)`` m, m, rad."""
        return np.sqrt(np.mean(self.errors**2, axis=0))

    @property
    def claimed(self) -> Array:
        """Standard deviations ``(3,)`` that the covariances claim, the root of their mean variances."""
        return np.sqrt(np.mean(np.diagonal(self.covariances, axis1=1, axis2=2), axis=0))

    @property
    def anees(self) -> float:
        """Mean normalised squared error / 3; 1 is honest."""
        solved = np.linalg.solve(self.covariances, self.errors[..., None])[..., 0]
        return float(np.mean(np.sum(self.errors * solved, axis=1)) / 3.0)


def pairs_at(place: str, count: int, rng: np.random.Generator) -> tuple[Pair, ...]:
    """Pairs from a place of `PLACES`: the same first pose, every time with other noise and another second."""
    walls, first = PLACES[place]
    caster = Raycaster.from_segments(walls)
    return tuple(
        look(caster, np.stack([first, se2.compose(first, rng.uniform(-APART, APART))]), rng)
        for _ in range(count)
    )


def trials(variant: Variant, pairs: Sequence[Pair], guesses: Array) -> Trials:
    """Match all pairs. Pairs without an answer are left out."""
    results, _ = match_all(variant.matcher, pairs, guesses)
    matched, errors = matches_and_errors(pairs, results)
    turns = np.array([turned(pair.poses[1, 2]) for pair, _ in matched]).reshape(-1, 3, 3)
    covariances = np.array([match.covariance for _, match in matched]).reshape(-1, 3, 3)
    along = np.einsum("nij,nj->ni", turns, errors)
    return Trials(along, turns @ covariances @ np.swapaxes(turns, 1, 2))


def seeded(pairs: Sequence[Pair], rng: np.random.Generator) -> Array:
    """Guesses ``(N, 3)`` off by normal errors of `GUESS_SIGMA`."""
    return np.array([pair.T_reference_scan for pair in pairs]) + rng.normal(0.0, GUESS_SIGMA, (len(pairs), 3))


def turned(yaw: float) -> Array:
    """Matrix ``(3, 3)`` from tangent vectors of a body that looks along ``yaw`` to the world's axes."""
    R = np.eye(3)
    R[:2, :2] = se2.rotation(yaw)
    return R


def efficiency(pairs: Sequence[Pair], walls: Array, errors: Array) -> tuple[float, float]:
    """Bound over measured mean squared errors of translation and rotation, 1 is as good as can be: of matches
    with ``errors (N, 3)`` m, m, rad, of pairs seen among ``walls (S, 4)``.

    Only beams that meet what the reference sees too count in the bound: no matcher can use the others.
    """
    bounds = np.array([np.linalg.inv(pair_information(pair, walls)) for pair in pairs])
    possible = np.einsum("nii->i", bounds)
    squares = np.sum(errors**2, axis=0)
    return float(possible[:2].sum() / squares[:2].sum()), float(possible[2] / squares[2])


def pair_information(pair: Pair, walls: Array) -> Array:
    """Information ``(3, 3)`` of both scans of a pair about the pose, in the body frame of the second."""
    reference, pose = pair.poses
    gradients = range_gradients(walls, pose, pair.angles)
    ranges, _ = hits(walls, pose, pose[2] + pair.angles)
    spots = pose[:2] + ranges[:, None] * directions(pose[2] + pair.angles)
    toward = spots - reference[:2]
    bearing = se2.wrap(np.arctan2(toward[:, 1], toward[:, 0]) - reference[2])
    sight, _ = hits(walls, reference, reference[2] + bearing)
    half_beam = 0.5 * (pair.angles[1] - pair.angles[0])
    inside = (bearing > pair.angles[0] - half_beam) & (bearing < pair.angles[-1] + half_beam)
    shared = inside & (np.abs(sight - np.hypot(*toward.T)) < SAME_SPOT) & (ranges < pair.laser.range_max)
    return gradients[shared].T @ gradients[shared] / (np.sqrt(2.0) * pair.laser.sigma_range) ** 2


def range_gradients(walls: Array, pose: Array, angles: Array) -> Array:
    """∂r/∂ξ ``(B, 3)`` of every beam for motion ξ of the body, T ∘ exp(ξ); NaN where nothing is met."""
    u = directions(pose[2] + angles)
    ranges, met = hits(walls, pose, pose[2] + angles)
    along = walls[met, 2:] - walls[met, :2]
    n = np.stack([-along[:, 1], along[:, 0]], -1) / np.hypot(*along.T)[:, None]
    across = np.sum(n * u, axis=1)
    by_yaw = -ranges * (n[:, 1] * u[:, 0] - n[:, 0] * u[:, 1]) / across
    return np.column_stack([-(n / across[:, None]) @ se2.rotation(pose[2]), by_yaw])


def hits(walls: Array, pose: Array, bearings: Array) -> tuple[Array, np.ndarray]:
    """Range ``(B,)`` m and wall ``(B,)`` that rays along world ``bearings (B,)`` meet first; inf for none."""
    u = directions(bearings)[:, None]
    a, e = walls[:, :2] - pose[:2], walls[:, 2:] - walls[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along a wall do not meet it
        parallel = _cross(u, e)
        r, t = _cross(a, e) / parallel, _cross(a, u) / parallel
        ranges = np.where((r > 0.0) & (t >= 0.0) & (t <= 1.0), r, np.inf)
    met = np.argmin(ranges, axis=1)
    return ranges[np.arange(len(bearings)), met], met


def directions(bearings: Array) -> Array:
    """Unit vectors ``(B, 2)``."""
    return np.stack([np.cos(bearings), np.sin(bearings)], -1)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
