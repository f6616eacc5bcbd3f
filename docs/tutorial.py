"""From a recording to a scored map, one stage after the other, in a few seconds.

Run it as it is, once the package is installed (`python docs/tutorial.py`), or cell by cell in an editor that
knows `# %%`. The pages beside this file have the equations.
"""

# %% [markdown]
# ## A small drive
# Two rooms with a door between them, a desk, two cupboards, a heap of rubble. A robot drives through both and
# back; its laser tilts with it, and its inertial sensor drifts. A seed is a drive: the same one every time.

# %%
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.evaluation import evaluate
from scenarios.evaluation.maps import map_at
from scenarios.evaluation.trajectory import aligned
from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from sim.floorplan import Door, cupboard, desk, wall
from sim.record import Setup, simulate
from sim.terrain import Terrain
from sim.world import World
from slam import se2
from slam.graph.gauss_newton import marginals
from slam.graph.odometry_factors import odometry_graph
from slam.graph.pose_graph import informations, optimise
from slam.mapping.submap import cut
from slam.odometry.dead_reckoning import DeadReckoning
from slam.odometry.segmentation import SegmentationConfig, segments
from slam.odometry.track import Verdict
from slam.odometry.tracker import FrontendConfig, track
from slam.scan import scans_of
from stitch import align
from stitch.align import Stitch


@dataclass(frozen=True)
class TwoRooms:
    """A scenario is anything with a name and a `build`."""

    name: str = "two_rooms"

    def build(self, rng: np.random.Generator) -> Setup:
        """Walls, furniture, ground and route; what is left to chance is drawn from ``rng``."""
        prisms = [
            *wall([0.0, 0.0], [9.0, 0.0]),
            *wall([9.0, 0.0], [9.0, 5.0]),
            *wall([9.0, 5.0], [0.0, 5.0]),
            *wall([0.0, 5.0], [0.0, 0.0]),
            *wall([4.0, 0.0], [4.0, 5.0], [Door(2.5)]),
            *desk([1.0, 4.3, 0.0]),
            *cupboard([6.0, 0.4, 0.0]),
            *cupboard([8.4, 3.5, 1.57]),
        ]
        ground = Terrain.level([-1.0, -1.0], [10.0, 6.0])
        ground = ground.with_rubble(np.array([6.5, 3.5]), 0.6, 0.02, np.radians(1.5), rng)
        route = [[1, 1], [3, 1], [3, 2.5], [5, 2.5], [5, 4], [7, 4], [7.5, 1.5], [5, 1.5], [5, 2.5], [1, 2.5]]
        return Setup(World(tuple(prisms), ground, ceiling=2.5), (1.0, 1.0, 0.0), np.array(route, dtype=float))


run = simulate(TwoRooms(), seed=100)
recording, truth = run.recording, run.recording.truth
print(
    f"{len(recording)} scans of {len(recording.angles)} beams over {recording.distance:.0f} m: {run.ending}"
)

# %% [markdown]
# ## Something goes wrong
# Half-way through, the laser sees nothing for a while, as in dense smoke.

# %%
middle = len(recording) // 2
ranges = recording.ranges.copy()
ranges[middle : middle + 6] = np.nan
recording = replace(recording, ranges=ranges)

# %% [markdown]
# ## Track
# The front end matches every scan to the last ones. What it cannot match follows dead reckoning, and says so.
# See [front_end.md](front_end.md).

# %%
scans = scans_of(recording)
found = track(recording, FrontendConfig(), scans)
lost = np.flatnonzero(found.verdict == Verdict.FELL_BACK)
print(f"lost scans: {lost.tolist()}")
print(f"median position variance of a step: {np.nanmedian(found.confidence['trace2']):.1e} m²")

# %% [markdown]
# ## Cut
# Where confidence is lost the map is cut. See [segmentation.md](segmentation.md).

# %%
pieces = segments(found, SegmentationConfig(rule="each_zero", least_steps=5))
print("segments:", ", ".join(f"{piece.start}–{piece.stop - 1}" for piece in pieces))
drawn = np.flatnonzero(found.verdict == Verdict.MATCHED)
submaps = [cut(recording, scans, found.poses, p.start, p.stop, np.union1d(drawn, p.start)) for p in pieces]

# %% [markdown]
# ## Stitch
# Two pieces are joined by their walls alone, with no guess of how they lie. An answer states its covariance;
# a pair that cannot be believed gets a reason instead. See [stitching.md](stitching.md).

# %%
first, second = submaps[0], submaps[-1]
stitch = align(first, second)
if isinstance(stitch, Stitch):
    T_true = se2.between(truth[first.start], truth[second.start])
    off = se2.between(T_true, stitch.T_a_b)
    print(f"stitched: off by {np.hypot(*off[:2]):.3f} m and {np.degrees(abs(off[2])):.2f}°")
    print(
        f"it says ± {np.sqrt(np.diag(stitch.covariance)[:2].max()):.3f} m, {len(stitch.alternatives)} others"
    )
else:
    print(f"not stitched: {stitch.reason}")

# %% [markdown]
# ## Pose graph
# The pieces' anchors are nodes, dead reckoning is the chain between them, stitches are loops that may be
# false. See [pose_graph.md](pose_graph.md).

# %%
anchors = np.array([submap.start for submap in submaps])
graph = odometry_graph(DeadReckoning(recording), found, anchors)
if isinstance(stitch, Stitch):
    pair = np.array([[0, len(submaps) - 1]])
    graph = graph.with_loops(pair, stitch.T_a_b[None], informations(pair, stitch.covariance[None]))
settled = optimise(graph, "gnc")
print(f"weights of the loops: {settled.weights.tolist()}")
print(f"the last piece is known to ± {np.sqrt(np.diag(marginals(graph, settled)[-1])[:2].max()):.3f} m")

# %% [markdown]
# ## The whole method, and what it is worth
# `slamstitch` does all of this for a whole drive, and adjusts a bundle at the end. `evaluate` scores any
# estimates against the truth. See [evaluation.md](evaluation.md).

# %%
estimates = [METHODS[name](recording, MethodConfig()) for name in ("ins", "slamstitch")]
scores = {(m.method, m.name): m.value for m in evaluate(recording, estimates)}
for estimate in estimates:
    ate, f1 = (scores[estimate.method, name] for name in ("ate_rmse", "map_f1"))
    print(f"{estimate.method:<11} position error {ate:.3f} m, walls right {f1:.2f}")

# %% [markdown]
# ## Look at it

# %%
from matplotlib.figure import Figure  # noqa: E402  (only this cell draws)

figure = Figure(figsize=(9.0, 3.0), layout="constrained")
for axes, estimate in zip(figure.subplots(1, 2, sharex=True, sharey=True), estimates, strict=True):
    poses = aligned(estimate.poses, truth)
    x, y = map_at(recording, poses).occupied_points().T
    axes.plot(x, y, "s", color="black", markersize=0.8)
    axes.plot(truth[:, 0], truth[:, 1], color="#e69f00", label="truth")
    axes.plot(poses[:, 0], poses[:, 1], color="#0072b2", label=estimate.method)
    axes.set(title=estimate.method, xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend(fontsize=7, loc="lower left")
picture = Path(tempfile.mkdtemp(prefix="slamstitch-")) / "two_rooms.png"
figure.savefig(picture, dpi=110)
print(picture)
