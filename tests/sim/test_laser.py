"""The ray caster against a slow, obvious twin, and against answers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.bench.building import building, free_poses
from sim import cells
from sim.floorplan import box, wall
from sim.laser import Raycaster
from sim.terrain import Terrain
from sim.world import Obstacles, World, plates, solids

ANGLES = np.linspace(-2.0944, 2.0944, 61)
REACH = 100.0


def directions(poses, angles):
    """Unit vectors (N * B, 3) of the beams: R = Rz(yaw) Ry(pitch) Rx(roll) as matrices."""
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    out = []
    for _, _, yaw, roll, pitch, _ in poses:
        (cz, sz), (cy, sy), (cx, sx) = [(np.cos(a), np.sin(a)) for a in (yaw, pitch, roll)]
        Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        out.append((Rz @ Ry @ Rx @ beams).T)
    return np.concatenate(out)


def brute_force(obstacles: Obstacles, poses, angles, ceiling=np.inf, floor=False):
    """Every ray against every edge, in horizontal distance and slope: another form of the same model."""
    b = directions(poses, angles)
    origin = np.repeat(poses[:, [0, 1, 5]], len(angles), axis=0)
    rho = np.hypot(b[:, 0], b[:, 1])
    u, slope = b[:, :2] / rho[:, None], b[:, 2] / rho
    best = np.full(len(b), np.inf)
    for k in range(len(obstacles.z_lo)):
        edges = obstacles.edges[obstacles.first[k] : obstacles.first[k + 1]]
        a, e = edges[None, :, :2] - origin[:, None, :2], edges[:, 2:] - edges[:, :2]
        crossing = u[:, None, 0] * e[:, 1] - u[:, None, 1] * e[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            d = (a[..., 0] * e[:, 1] - a[..., 1] * e[:, 0]) / crossing
            t = (a[..., 0] * u[:, None, 1] - a[..., 1] * u[:, None, 0]) / crossing
        met = (t >= 0) & (t <= 1)
        d_in = np.where(met, d, np.inf).min(axis=1)
        d_out = np.where(met, d, -np.inf).max(axis=1)
        d_in = np.where(d_in == np.inf, np.inf, np.maximum(d_in, 0.0))  # starting inside the footprint
        valid = d_out >= 0 if len(edges) > 1 else met[:, 0] & (d[:, 0] >= 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            lo, hi = obstacles.z_lo[k], obstacles.z_hi[k]
            z_in, z_out = origin[:, 2] + slope * d_in, origin[:, 2] + slope * d_out
            front = (z_in >= lo) & (z_in <= hi)
            top, under = (z_in > hi) & (z_out < hi), (z_in < lo) & (z_out > lo)
            hit = np.where(top, (hi - origin[:, 2]) / slope, np.inf)
            hit = np.where(under, (lo - origin[:, 2]) / slope, hit)
        best = np.where(valid, np.minimum(best, np.where(front, d_in, hit)), best)
    with np.errstate(divide="ignore"):
        if floor:
            best = np.minimum(best, np.where(slope < 0, -origin[:, 2] / slope, np.inf))
        best = np.minimum(best, np.where(slope > 0, (ceiling - origin[:, 2]) / slope, np.inf))
    ranges = best / rho
    return np.where(ranges > REACH, np.nan, ranges).reshape(len(poses), len(angles))


def random_world(rng, n=60):
    prisms = []
    for _ in range(n):
        pose = [*rng.uniform(0, 20, 2), rng.choice([0.0, rng.uniform(-3, 3)])]
        lo = rng.uniform(-0.1, 0.8)
        prisms.append(
            box(pose, rng.uniform(0.05, 3.0), rng.uniform(0.05, 0.8), lo, lo + rng.uniform(0.05, 1.5))
        )
    return World(tuple(prisms), Terrain.level([-1.0, -1.0], [21.0, 21.0], 0.5), 2.5)


def random_poses(rng, n, tilt):
    return np.column_stack(
        [
            rng.uniform(-1, 21, (n, 2)),
            rng.uniform(-4, 4, n),
            rng.uniform(-tilt, tilt, (n, 2)),
            rng.uniform(0.1, 0.6, n),
        ]
    )


@pytest.mark.parametrize("tilt", [0.0, 0.1, 1.0, 3.0])
def test_solids_floor_and_ceiling_agree_with_brute_force(tilt):
    """45,000 rays, level, leaning and upside down."""
    rng = np.random.default_rng(1)
    world, poses = random_world(rng), random_poses(rng, 184, tilt)
    expected = brute_force(world.obstacles, poses, ANGLES, world.ceiling, floor=True)
    ranges = Raycaster(world).cast(poses, ANGLES, REACH)
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-9)
    assert np.isfinite(expected).mean() > 0.4


@pytest.mark.parametrize("heights", [None, "tops", "bands"])
def test_segments_agree_with_brute_force(heights):
    """65,000 rays; many poses are outside of the walls."""
    rng = np.random.default_rng(2)
    a = rng.uniform(0, 30, (150, 2))
    segments = np.hstack([a, a + rng.normal(0, 2.0, (150, 2))])
    values = {None: None, "tops": rng.uniform(0, 1, 150), "bands": np.sort(rng.uniform(0, 1, (150, 2)))}[
        heights
    ]
    poses = random_poses(rng, 360, 0.15)
    poses[:, :2] = rng.uniform(-20, 50, (360, 2))
    expected = brute_force(plates(segments, values), poses, ANGLES)
    ranges = Raycaster.from_segments(segments, values).cast(poses, ANGLES, REACH)
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-9)
    assert np.isfinite(expected).any()


@pytest.mark.parametrize("field_of_view", [0.0, 1.0, np.pi, 4.2, 2 * np.pi, 9.0])
def test_what_lies_behind_a_fan_is_not_missed_ahead(field_of_view):
    """Fans of any width, their beams in any order."""
    rng = np.random.default_rng(6)
    world, poses = random_world(rng), random_poses(rng, 60, 0.3)
    angles = rng.permutation(np.linspace(-0.5, 0.5, 41) * field_of_view + rng.uniform(-9, 9))
    expected = brute_force(world.obstacles, poses, angles, world.ceiling, floor=True)
    ranges = Raycaster(world).cast(poses, angles, REACH)
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-9)


def nearest_crossing(segments, origin, direction, slack):
    """Brute force for one ray, its plates made longer (or shorter) by ``slack`` m across the ray."""
    a, b = segments[:, :2] - origin, segments[:, 2:] - origin
    side_a, side_b = (
        a[:, 0] * direction[1] - a[:, 1] * direction[0],
        b[:, 0] * direction[1] - b[:, 1] * direction[0],
    )
    met = np.minimum(side_a, side_b) <= slack
    met &= np.maximum(side_a, side_b) >= -slack
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / (side_a - side_b)
    return np.min(r[met & (r >= 0)], initial=np.inf)


def test_rays_at_corners_agree_with_brute_force_to_either_side():
    """20,000 rays at the ends of walls, and past them by a hair.

    Within rounding an end is met or missed: the range is that of walls longer or shorter by 1e-12 m.
    """
    rng = np.random.default_rng(7)
    segments = building(200, rng)
    caster = Raycaster.from_segments(segments)
    poses = free_poses(segments, 50, rng)
    ends = segments.reshape(-1, 2)
    for pose in poses:
        aims = ends[rng.integers(len(ends), size=400)]
        angles = np.arctan2(*(aims - pose[:2]).T[::-1]) + rng.choice([0.0, 0.0, 1e-15, -1e-13, 1e-9], 400)
        ranges = caster.cast([[*pose[:2], 0.0]], angles)[0]
        for r, angle in zip(ranges, angles, strict=True):
            direction = np.array([np.cos(angle), np.sin(angle)])
            either = [nearest_crossing(segments, pose[:2], direction, slack) for slack in (1e-12, -1e-12)]
            assert np.min(np.abs(r - either)) < 1e-9


@pytest.mark.parametrize("hair", [1e-3, 1e-5, 1e-7])
def test_rays_that_graze_a_wall(hair):
    """Along a wall on y = 0 at a slope of a hair: met where they cross it, to what a double can say."""
    caster = Raycaster.from_segments([[0.0, 0.0, 20.0, 0.0], [30.0, -5.0, 30.0, 5.0]])
    starts = np.linspace(0.6, 15.0, 30)
    poses = np.column_stack([np.zeros(30) - 1.0, hair * starts, np.full(30, -np.arctan(hair))])
    ranges = caster.cast(poses, [0.0])[:, 0]
    met = starts > 1.0  # the others pass before its beginning
    np.testing.assert_allclose(ranges[met], (starts * np.hypot(1.0, hair))[met], atol=1e-14 / hair)
    np.testing.assert_allclose(ranges[~met], 31.0 * np.hypot(1.0, hair), atol=1e-9)


def test_rays_along_the_borders_of_the_grid():
    """From the corners of cells along the lines between cells, and diagonally through their corners."""
    ring = [[0, 0, 16, 0], [16, 0, 16, 16], [16, 16, 0, 16], [0, 16, 0, 0]]
    caster, grid = Raycaster.from_segments(ring), cells.build(plates(ring))
    i, j = (nodes.ravel() for nodes in np.meshgrid(np.arange(grid.columns), np.arange(grid.rows)))
    x, y = grid.x0 + grid.size * i, grid.y0 + grid.size * j
    inside = (x > 0) & (x < 16) & (y > 0) & (y < 16)
    for yaw, expected in (
        (0.0, 16 - x), (-0.0, 16 - x), (np.pi, x), (np.pi / 2, 16 - y), (-np.pi / 2, y),
        (np.pi / 4, np.sqrt(2) * (16 - np.maximum(x, y))), (-3 * np.pi / 4, np.sqrt(2) * np.minimum(x, y)),
    ):  # fmt: skip
        poses = np.column_stack([x, y, np.full(len(x), yaw)])[inside]
        np.testing.assert_allclose(caster.cast(poses, [0.0])[:, 0], expected[inside], atol=1e-9)


def test_planar_cast_ignores_heights_floor_and_ceiling():
    rng = np.random.default_rng(3)
    world, poses = random_world(rng), random_poses(rng, 80, 0.0)
    endless = world.obstacles.without_heights()
    expected = brute_force(endless, poses, ANGLES)
    np.testing.assert_allclose(
        Raycaster(world).cast(poses[:, :3], ANGLES, REACH), expected, rtol=0, atol=1e-9
    )


@settings(max_examples=60, deadline=None)
@given(
    x=st.integers(-6, 6),
    y=st.integers(-6, 6),
    quarter=st.integers(0, 7),
    size=st.sampled_from([1.0, 2.0, 0.5]),
)
def test_rays_along_axes_and_through_corners(x, y, quarter, size):
    """Rays that graze faces, run along walls or aim at corners: hit within a hair of the true contact."""
    caster = Raycaster(World((box([0, 0, 0], 2 * size, 2 * size),), Terrain.level([-9, -9], [9, 9], 1.0)))
    angle = quarter * np.pi / 4
    r = caster.cast([[x, y, 0.0]], [angle])[0, 0]
    along = np.array([np.cos(angle), np.sin(angle)])
    at = np.array([x, y]) + np.linspace(0.0, 20.0, 40001)[:, None] * along
    distance = np.abs(at).max(axis=1) - size
    if np.isnan(r):
        assert distance.min() > -1e-6
    else:
        assert abs(np.abs(np.array([x, y]) + r * along).max() - size) < 1e-9 or (
            r == 0.0 and distance[0] <= 0
        )
        assert distance[: max(0, int(r / 20.0 * 40000) - 1)].min(initial=1.0) > -1e-6


def test_a_closed_room_never_leaks():
    """Aimed at the corners where walls meet, and everywhere else, every beam comes back."""
    corners = np.array([[0, 0], [7, 0], [7, 4], [0, 4.0]])
    segments = np.hstack([corners, np.roll(corners, -1, axis=0)])
    rng = np.random.default_rng(4)
    positions = rng.uniform([0.1, 0.1], [6.9, 3.9], (300, 2))
    at_corners = np.arctan2(*(corners[None] - positions[:, None]).transpose(2, 0, 1)[::-1])
    caster = Raycaster.from_segments(segments)
    for position, aims in zip(positions, at_corners, strict=True):
        angles = np.concatenate([aims, np.arange(0, 2 * np.pi, 0.1)])
        ranges = caster.cast([[*position, 0.0]], angles)[0]
        assert np.all(np.isfinite(ranges[4:]))
        seen = np.isfinite(ranges[:4])  # a corner is two end points: rounding may put the ray past both
        expected = np.hypot(*(corners - position).T)
        np.testing.assert_allclose(ranges[:4][seen], expected[seen], atol=1e-9)


def test_a_plate_met_edge_on_is_hit_at_its_nearer_end():
    for plate in ([2.0, 0.0, 5.0, 0.0], [5.0, 0.0, 2.0, 0.0]):
        caster = Raycaster.from_segments([plate])
        ranges = caster.cast([[0, 0, 0], [3, 0, 0], [6, 0, 0], [0, 0.1, 0]], [0.0])[:, 0]
        np.testing.assert_allclose(ranges, [2.0, 0.0, np.nan, np.nan], atol=1e-12)


def test_nothing_beyond_range_max():
    caster = Raycaster.from_segments([[3.0, -1.0, 3.0, 1.0]])
    assert caster.cast([[0, 0, 0]], [0.0], range_max=3.1)[0, 0] == 3.0
    assert np.isnan(caster.cast([[0, 0, 0]], [0.0], range_max=2.9)[0, 0])


OPEN = World((), Terrain.level([-10, -10], [10, 10], 0.5))


@pytest.mark.parametrize(("pitch", "distance"), [(5.0, 3.429), (10.0, 1.701)])
def test_floor_seen_by_a_nose_down_laser(pitch, distance):
    """h = 0.30 m: the floor is met 3.43 m (5°) and 1.70 m (10°) ahead."""
    theta = np.deg2rad(pitch)
    ranges = Raycaster(OPEN).cast([[0, 0, 0.3, 0, theta, 0.30]], [0.0, np.pi])
    assert ranges[0, 0] * np.cos(theta) == pytest.approx(distance, abs=1e-3)
    assert np.isnan(ranges[0, 1])


def test_roll_lowers_the_right_side():
    """Roll is left side up: the floor appears to the right (negative angles)."""
    ranges = Raycaster(OPEN).cast([[0, 0, 1.0, np.deg2rad(5), 0, 0.30]], [-np.pi / 2, np.pi / 2])
    assert ranges[0, 0] == pytest.approx(0.30 / np.sin(np.deg2rad(5)))
    assert np.isnan(ranges[0, 1])


@pytest.mark.parametrize(
    ("z_lo", "z_hi", "pitch", "z", "expected"),
    [
        (-1.0, 0.20, 0.05, 0.30, 0.10 / np.tan(0.05)),  # over its front edge, lands on its top (2 m)
        (-1.0, 0.05, 0.05, 0.30, 0.30 / np.tan(0.05)),  # passes over, meets the floor behind it
        (-1.0, 0.25, 0.05, 0.30, 1.5),  # its front
        (0.35, 0.60, 0.0, 0.30, np.nan),  # level: passes under
        (0.40, 0.60, -0.05, 0.30, 0.10 / np.tan(0.05)),  # nose up: meets its underside
        (0.50, 0.60, -0.05, 0.30, np.nan),  # nose up, but not enough
    ],
)
def test_over_under_and_on_top(z_lo, z_hi, pitch, z, expected):
    """A box from x = 1.5 to 3 m."""
    caster = Raycaster(World((box([2.25, 0, 0], 1.5, 2.0, z_lo, z_hi),), OPEN.terrain))
    r = caster.cast([[0, 0, 0, 0, pitch, z]], [0.0])[0, 0]
    np.testing.assert_allclose(r * np.cos(pitch), expected, atol=1e-12)


def test_ceiling_and_straight_down():
    caster = Raycaster(World((), OPEN.terrain, 2.5))
    assert caster.cast([[0, 0, 0, 0, -np.pi / 2, 0.3]], [0.0])[0, 0] == pytest.approx(2.2)
    assert caster.cast([[0, 0, 0, 0, np.pi / 2, 0.3]], [0.0])[0, 0] == pytest.approx(0.3)


def test_ground_agrees_with_marching():
    """Ray and height field: cell-wise quadratics against small steps and bisection."""
    rng = np.random.default_rng(5)
    terrain = Terrain.level([0, 0], [6, 6], 0.1).with_ramp([1, 3], [3, 3], 2.0, 0.3)
    terrain = terrain.with_sill([4, 1], [4, 5], 0.1, 0.3).with_rubble([3, 4.5], 1.2, 0.08, 0.0, rng)
    poses = np.column_stack(
        [
            rng.uniform(-0.5, 6.5, (60, 2)),
            rng.uniform(-3, 3, 60),
            rng.uniform(-0.3, 0.3, (60, 2)),
            np.full(60, 0.6),
        ]
    )
    angles = np.linspace(-1, 1, 5)
    ranges = Raycaster(World((), terrain)).cast(poses, angles, range_max=5.0).ravel()
    b, origin = directions(poses, angles), np.repeat(poses[:, [0, 1, 5]], len(angles), axis=0)
    expected = np.full(len(b), np.nan)
    steps = np.linspace(0.0, 5.0, 20001)
    for k in range(len(b)):
        above = heights_above(terrain, origin[k] + steps[:, None] * b[k])
        below = np.flatnonzero(above <= 0)
        if below.size:
            lo, hi = steps[below[0] - 1], steps[below[0]]
            for _ in range(60):
                mid = 0.5 * (lo + hi)
                lo, hi = (mid, hi) if heights_above(terrain, origin[k] + mid * b[k]) > 0 else (lo, mid)
            expected[k] = hi
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-9)
    assert np.isfinite(expected).mean() > 0.2


def heights_above(terrain: Terrain, points):
    """Height of points (..., 3) above the bilinear ground."""
    f = (points[..., :2] - terrain.origin) / terrain.resolution
    rows, columns = terrain.heights.shape
    inside = np.all((f >= 0) & (f <= [columns - 1, rows - 1]), axis=-1)
    i, j = (np.clip(f[..., k].astype(int), 0, n - 2) for k, n in ((0, columns), (1, rows)))
    u, v = f[..., 0] - i, f[..., 1] - j
    h = terrain.heights
    ground = (1 - v) * ((1 - u) * h[j, i] + u * h[j, i + 1]) + v * (
        (1 - u) * h[j + 1, i] + u * h[j + 1, i + 1]
    )
    return points[..., 2] - np.where(inside, ground, 0.0)


def test_incidence_of_wall_and_floor():
    world = World(tuple(wall([2.0, -1.0], [2.0, 1.0], thickness=0.2)), OPEN.terrain)
    _, cosines = Raycaster(world).cast_with_incidence([[0, 0, 0, 0, 0, 0.3]], [0.0, 0.4])
    np.testing.assert_allclose(cosines[0], [1.0, np.cos(0.4)])
    _, cosines = Raycaster(OPEN).cast_with_incidence([[0, 0, 0, 0, 0.2, 0.3]], [0.0])
    assert cosines[0, 0] == pytest.approx(np.sin(0.2))


@pytest.mark.parametrize(
    "call",
    [
        lambda: Raycaster.from_segments([[0, 0, 1]]),
        lambda: Raycaster.from_segments([[0, 0, 0, 0]]),
        lambda: Raycaster.from_segments([[0, 0, 1, 1]], [[1, 2, 3]]),
        lambda: Raycaster(OPEN).cast([[0, 0]], [0.0]),
        lambda: Raycaster(OPEN).cast([[0, 0, np.nan]], [0.0]),
    ],
)
def test_bad_shapes_are_refused(call):
    with pytest.raises(ValueError, match=r"segments|heights|poses"):
        call()


def test_no_obstacles_at_all():
    assert np.all(np.isnan(Raycaster.from_segments(np.empty((0, 4))).cast([[0, 0, 0]], ANGLES)))
    assert len(solids(()).z_lo) == 0


def test_without_floor_there_is_no_ceiling():
    up = [[0, 0, 0, 0, -0.5, 0.3]]
    assert Raycaster(World((), OPEN.terrain, 2.5)).cast(up, [0.0])[0, 0] == pytest.approx(2.2 / np.sin(0.5))
    assert np.isnan(Raycaster(World((), OPEN.terrain, 2.5), floor=False).cast(up, [0.0])[0, 0])
