"""A map laid onto another, bent where the pieces ask for it: a lattice of poses with springs between them.

Point to line by facing, robust (Welsch), by Gauss–Newton with widths that shrink.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from scipy.linalg import LinAlgError, solveh_banded

from slam import se2
from slam.se2 import Array
from stitch.alignment.config import TolerantConfig
from stitch.alignment.facing import CELL, UNKNOWN, FacingWalls

HELD = 1e-6
"""Added to the diagonal of the normal equations: a map that touches nothing stays where it is."""


@dataclass(frozen=True)
class Bend:
    """Map b bent into the frame of a, by poses ``nodes (R, C, 3)`` in a of the knots of a lattice in b.

    Knot (row, column) lies at ``first (2,) + spacing·(column, row)`` m in the lattice's frame, and that at
    ``frame (3,)`` in b. A point of b follows the four knots around it, each rigidly, blended bilinearly;
    beyond the lattice, the nearest of its cells.
    """

    first: Array
    spacing: float
    nodes: Array
    frame: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def rigid(cls, walls: FacingWalls, T_a_b: Array, spacing: float) -> Bend:
        """A lattice over walls, not bent."""
        low, high = walls.points.min(axis=0), walls.points.max(axis=0)
        columns, rows = np.maximum(np.ceil((high - low) / spacing).astype(int), 1) + 1
        first = 0.5 * (low + high) - 0.5 * spacing * (np.array([columns, rows]) - 1)
        return cls(first, spacing, np.empty((rows, columns, 3))).moved_to(T_a_b)

    @property
    def knots(self) -> Array:
        """Places ``(R, C, 2)`` m of the knots in the lattice's frame."""
        rows, columns = self.nodes.shape[:2]
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        return self.first + self.spacing * np.stack([x, y], -1)

    @property
    def places(self) -> Array:
        """Places ``(R, C, 2)`` m of the knots in b."""
        return se2.transform(self.frame, self.knots)

    def between_maps(self, anchor_a: Array, anchor_b: Array) -> Bend:
        """The bend of one map onto another that have the frames of a and b at ``anchor_a (3,)`` and
        ``anchor_b (3,)``."""
        return replace(self, nodes=se2.compose(anchor_a, self.nodes), frame=se2.compose(anchor_b, self.frame))

    def displacements(self, T_a_b: Array) -> Array:
        """Where the knots are beyond where ``T_a_b (3,)`` puts them ``(R, C, 3)``: x and y m, yaw rad."""
        off = np.empty_like(self.nodes)
        off[..., :2] = self.nodes[..., :2] - se2.transform(T_a_b, self.places)
        off[..., 2] = se2.wrap(self.nodes[..., 2] - T_a_b[2] - self.frame[2])
        return off

    def moved_to(self, T_a_b: Array) -> Bend:
        """The lattice at ``T_a_b (3,)``, not bent."""
        nodes = np.empty_like(self.nodes)
        nodes[..., :2] = se2.transform(T_a_b, self.places)
        nodes[..., 2] = T_a_b[2] + self.frame[2]
        return replace(self, nodes=nodes)

    def apply(self, points: Array) -> Array:
        """Points ``(n, 2)`` m of b in the frame of a."""
        local = se2.transform(se2.inverse(self.frame), points)
        return apply_lattice(self.nodes, self.first, self.spacing, local)[:, :2]

    def undo(self, points: Array, T_a_b: Array) -> Array:
        """Points ``(n, 2)`` m of a in the frame of b; ``T_a_b (3,)`` is about where it lies."""
        guess = se2.transform(se2.inverse(se2.compose(T_a_b, self.frame)), points)
        for _ in range(4):
            there = apply_lattice(self.nodes, self.first, self.spacing, guess)
            off = points - there[:, :2]
            c, s = np.cos(there[:, 2]), np.sin(there[:, 2])
            guess = guess + np.stack([c * off[:, 0] + s * off[:, 1], -s * off[:, 0] + c * off[:, 1]], -1)
        return se2.transform(self.frame, guess)

    def largest_displacement(self, T_a_b: Array) -> float:
        """How far the bend takes a knot from where ``T_a_b (3,)`` puts it [m], at most."""
        return float(np.max(np.linalg.norm(self.displacements(T_a_b)[..., :2], axis=-1)))

    def lines(self, points: int = 8) -> list[Array]:
        """The lattice's rows and columns, bent: each ``(n, 2)`` m in a, ``points`` for each of its cells."""
        rows, columns = self.nodes.shape[:2]
        x, y = (
            self.first[axis] + self.spacing * np.linspace(0.0, count - 1, points * (count - 1) + 1)
            for axis, count in enumerate((columns, rows))
        )
        level = [np.stack([x, np.full(len(x), one)], -1) for one in y[::points]]
        upright = [np.stack([np.full(len(y), one), y], -1) for one in x[::points]]
        return [self.apply(se2.transform(self.frame, line)) for line in (*level, *upright)]

    def energy(self, config: TolerantConfig) -> float:
        """What the springs hold, in squared standard deviations, halved."""
        return float(spring_energy(self.nodes, self.spacing, *_springs(self.spacing, config)))

    def least_jacobian(self, points: Array) -> float:
        """Least determinant of the field's Jacobian at ``points (n, 2)`` m: not above 0 where it folds."""
        step = 0.05
        middle = self.apply(points)
        dx, dy = ((self.apply(points + step * axis) - middle) / step for axis in np.eye(2))
        return float(np.min(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]))


def _springs(spacing: float, config: TolerantConfig) -> tuple[float, float]:
    """Stiffness of a spring between two knots, 1/m² and 1/rad²."""
    shift, turn = config.spring
    return 1.0 / (shift**2 * spacing / 4.0), 1.0 / (turn**2 * spacing / 4.0)


@njit(cache=True)
def _cell(x, y, first, spacing, rows, columns):
    """Row and column of the lattice's cell around a place, and the place in it, 0 to 1."""
    u, v = (x - first[0]) / spacing, (y - first[1]) / spacing
    column = min(max(int(np.floor(u)), 0), columns - 2)
    row = min(max(int(np.floor(v)), 0), rows - 2)
    return row, column, min(max(u - column, 0.0), 1.0), min(max(v - row, 0.0), 1.0)


@njit(cache=True)
def _knot(q, x, y, first, spacing, cell):
    """Knot q of 4 around a place: its row and column, its share of it, and the place seen from it."""
    row, column, u, v = cell
    i, j = row + q // 2, column + q % 2
    share = (v if q // 2 else 1.0 - v) * (u if q % 2 else 1.0 - u)
    return i, j, share, x - first[0] - spacing * j, y - first[1] - spacing * i


@njit(cache=True)
def _carry(nodes, cosine, sine, first, spacing, x, y):
    """Place in a and turn of one place in b; ``cosine`` and ``sine (R, C)`` of the knots' turns."""
    cell = _cell(x, y, first, spacing, nodes.shape[0], nodes.shape[1])
    there_x = there_y = turn = 0.0
    for q in range(4):
        i, j, share, dx, dy = _knot(q, x, y, first, spacing, cell)
        c, s = cosine[i, j], sine[i, j]
        there_x += share * (nodes[i, j, 0] + c * dx - s * dy)
        there_y += share * (nodes[i, j, 1] + s * dx + c * dy)
        turn += share * nodes[i, j, 2]
    return there_x, there_y, turn


@njit(cache=True)
def apply_lattice(nodes, first, spacing, points):
    """Places in a and turn ``(n, 3)`` of ``points (n, 2)`` m of b."""
    out = np.empty((len(points), 3))
    cosine, sine = np.cos(nodes[:, :, 2]), np.sin(nodes[:, :, 2])
    for p in range(len(points)):
        x, y = points[p, 0], points[p, 1]
        out[p, 0], out[p, 1], out[p, 2] = _carry(nodes, cosine, sine, first, spacing, x, y)
    return out


@njit(cache=True)
def pair_with(x, y, angle, known, weight, width, points, angles, nearest, corner):
    """The point of another map's walls that suits one at ``(x, y)`` m facing ``angle`` rad best: its index
    (−1: none) and the agreement, weighed by metres of wall."""
    j, i = int(np.floor((x - corner[0]) / CELL)), int(np.floor((y - corner[1]) / CELL))
    best, most = -1, 0.0
    if i < 0 or j < 0 or i >= nearest.shape[1] or j >= nearest.shape[2]:
        return best, most
    for k in range(UNKNOWN + 1):
        p = nearest[k, i, j]
        if p < 0:
            continue
        share = 0.25
        if known and k < UNKNOWN:
            c = np.cos(angle - angles[p])
            share = 0.25 + 0.5 * c + 0.25 * (2.0 * c * c - 1.0)
        dx, dy = points[p, 0] - x, points[p, 1] - y
        value = share * np.exp(-0.5 * (dx * dx + dy * dy) / (width * width))
        if value > most:
            best, most = p, value
    return best, weight * most


@njit(cache=True)
def normal_equations(
    nodes, first, spacing, width, points_b, angles_b, known_b, weights_b, points, angles, known_a, nearest,
    corner,
):  # fmt: skip
    """Normal equations of point to line over the knots: banded ``(W, 3 R C)`` lower form and right side."""
    rows, columns, _ = nodes.shape
    band = 3 * (columns + 2)
    A, g = np.zeros((band, 3 * rows * columns)), np.zeros(3 * rows * columns)
    cosine, sine = np.cos(nodes[:, :, 2]), np.sin(nodes[:, :, 2])
    jacobian, index = np.zeros(12), np.zeros(12, np.int64)
    for p in range(len(points_b)):
        if not known_b[p]:
            continue
        own_x, own_y = points_b[p, 0], points_b[p, 1]
        x, y, turn = _carry(nodes, cosine, sine, first, spacing, own_x, own_y)
        partner, agreement = pair_with(
            x, y, angles_b[p] + turn, True, weights_b[p], width, points, angles, nearest, corner
        )
        if partner < 0 or agreement < 1e-4 * weights_b[p] or not known_a[partner]:
            continue
        nx, ny = np.cos(angles[partner]), np.sin(angles[partner])
        residual = nx * (x - points[partner, 0]) + ny * (y - points[partner, 1])
        weight = agreement / (width * width)
        cell = _cell(own_x, own_y, first, spacing, rows, columns)
        for q in range(4):
            i, j, share, bx, by = _knot(q, own_x, own_y, first, spacing, cell)
            c, s = cosine[i, j], sine[i, j]
            at = 3 * (i * columns + j)
            index[3 * q], index[3 * q + 1], index[3 * q + 2] = at, at + 1, at + 2
            jacobian[3 * q], jacobian[3 * q + 1] = share * nx, share * ny
            jacobian[3 * q + 2] = share * (nx * (-s * bx - c * by) + ny * (c * bx - s * by))
        for r in range(12):
            g[index[r]] -= weight * jacobian[r] * residual
            for t in range(12):
                if index[r] >= index[t]:
                    A[index[r] - index[t], index[t]] += weight * jacobian[r] * jacobian[t]
    return A, g


@njit(cache=True)
def _extension(nodes, spacing, i, j, down):
    """A spring from knot (i, j) to the next of its row, or ``down`` its column: how far that is from where
    the mean turn of both expects it (x and y m, yaw rad), and what a turn adds to it (m/rad)."""
    k, m = (i + 1, j) if down else (i, j + 1)
    lx, ly = (0.0, spacing) if down else (spacing, 0.0)
    turn = 0.5 * (nodes[i, j, 2] + nodes[k, m, 2])
    c, s = np.cos(turn), np.sin(turn)
    off = (
        nodes[k, m, 0] - nodes[i, j, 0] - (c * lx - s * ly),
        nodes[k, m, 1] - nodes[i, j, 1] - (s * lx + c * ly),
        nodes[k, m, 2] - nodes[i, j, 2],
    )
    return off, (0.5 * (s * lx + c * ly), 0.5 * (-c * lx + s * ly), 0.0)


@njit(cache=True)
def add_springs(A, g, nodes, spacing, stiff, stiff_turn):
    """Add the springs between neighbouring knots to the normal equations, in place."""
    rows, columns, _ = nodes.shape
    jacobian, index = np.zeros(6), np.zeros(6, np.int64)
    for i in range(rows):
        for j in range(columns):
            for down in range(2):
                k, m = (i + 1, j) if down else (i, j + 1)
                if k >= rows or m >= columns:
                    continue
                off, lever = _extension(nodes, spacing, i, j, down)
                at, to = 3 * (i * columns + j), 3 * (k * columns + m)
                for q in range(3):
                    index[q], index[3 + q] = at + q, to + q
                for axis in range(3):
                    jacobian[:] = 0.0
                    jacobian[axis] = -1.0
                    jacobian[3 + axis] = 1.0
                    jacobian[2] += lever[axis]
                    jacobian[5] += lever[axis]
                    weight = stiff_turn if axis == 2 else stiff
                    for r in range(6):
                        g[index[r]] -= weight * jacobian[r] * off[axis]
                        for t in range(6):
                            if index[r] >= index[t]:
                                A[index[r] - index[t], index[t]] += weight * jacobian[r] * jacobian[t]


@njit(cache=True)
def spring_energy(nodes, spacing, stiff, stiff_turn):
    """Half the sum of the springs' squared extensions, weighed."""
    rows, columns, _ = nodes.shape
    total = 0.0
    for i in range(rows):
        for j in range(columns):
            for down in range(2):
                if (i + 1 if down else j + 1) < (rows if down else columns):
                    (dx, dy, dt), _ = _extension(nodes, spacing, i, j, down)
                    total += 0.5 * (stiff * (dx * dx + dy * dy) + stiff_turn * dt * dt)
    return total


def of_walls(walls: FacingWalls) -> tuple[Array, Array, np.ndarray, np.ndarray, Array]:
    """What the kernels read of the map that is matched against."""
    return walls.points, walls.angles, walls.known, walls.nearest, walls.corner


def settle(a: FacingWalls, b: FacingWalls, T_a_b: Array, config: TolerantConfig) -> Array:
    """The rigid alignment ``(3,)`` near ``T_a_b (3,)`` that walls facing the same way agree on."""
    pivot = b.middle
    lattice = Bend(pivot, 1e6, np.zeros((2, 2, 3)))  # of one cell, whose first knot carries everything
    at = np.array([*se2.transform(T_a_b, pivot[None])[0], T_a_b[2]])
    for width in np.geomspace(*config.settle_widths, config.settle_steps):
        lattice.nodes[0, 0] = at
        A, g = normal_equations(
            lattice.nodes, lattice.first, lattice.spacing, width, b.points, b.angles, b.known, b.weights,
            *of_walls(a),
        )  # fmt: skip
        full = np.array([[A[abs(r - t), min(r, t)] for t in range(3)] for r in range(3)])
        at = at + np.linalg.solve(full + HELD * np.eye(3), g[:3])
    return np.array([*(at[:2] - se2.rotation(at[2]) @ pivot), se2.wrap(at[2])])


def bend(a: FacingWalls, b: FacingWalls, T_a_b: Array, config: TolerantConfig) -> Bend:
    """Map b bent onto a from ``T_a_b (3,)`` on."""
    lattice = Bend.rigid(b, T_a_b, config.spacing)
    stiff = [config.stiffness * k for k in _springs(config.spacing, config)]
    nodes = lattice.nodes
    for width in np.geomspace(*config.bend_widths, config.bend_steps):
        A, g = normal_equations(
            nodes, lattice.first, lattice.spacing, width, b.points, b.angles, b.known, b.weights, *of_walls(a)
        )
        add_springs(A, g, nodes, lattice.spacing, *stiff)
        A[0] += HELD
        try:
            step = solveh_banded(A, g, lower=True, check_finite=False, overwrite_ab=True)
        except LinAlgError:
            break
        nodes = nodes + step.reshape(nodes.shape)
    return replace(lattice, nodes=nodes)
