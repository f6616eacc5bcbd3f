"""Pictures of a simulated world show what happened in it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from scenarios.report.figures import run_specs
from scenarios.report.world_figures import draw_from_above, draw_from_the_side
from sim.floorplan import box, wall
from sim.record import Setup, SimulatedRun, simulate
from sim.terrain import Terrain
from sim.world import World
from slam.odometry.tracker import MANIFOLD_SLAM, track
from stitch.mapping.estimate import Estimate


class Room:
    """A room with a ramp on the way and a low box."""

    name = "room"

    def build(self, rng: np.random.Generator) -> Setup:
        corners = np.array([[0.0, 0.0], [7.0, 0.0], [7.0, 3.0], [0.0, 3.0], [0.0, 0.0]])
        walls = [p for a, b in pairwise(corners) for p in wall(a, b)]
        ground = Terrain.level([-1.0, -1.0], [8.0, 4.0]).with_ramp([2.5, 1.5], [3.5, 1.5], 1.5, 0.1)
        low = box([5.5, 2.5, 0.0], 0.4, 0.4, z_hi=0.2)
        return Setup(World((*walls, low), ground, 2.5), (1.0, 1.5, 0.0), np.array([[1.5, 1.5], [6.0, 1.5]]))


@pytest.fixture(scope="module")
def run() -> SimulatedRun:
    return simulate(Room(), 0)


def test_failures_of_the_matcher_are_marked_where_they_happened(run: SimulatedRun) -> None:
    found = track(run.recording, MANIFOLD_SLAM)
    matches = found.matches.copy()
    tried = np.flatnonzero(found.verdict != 2)
    matches[:] = 50
    matches[tried[[3, 5]]] = 0
    figure = draw_from_above(run, Estimate("wsm", found.poses, track=replace(found, matches=matches)))
    marks = figure.axes[0].collections[-1].get_offsets()
    assert run.recording.truth is not None
    np.testing.assert_allclose(np.asarray(marks), run.recording.truth[tried[[3, 5]], :2])


def test_the_path_is_coloured_by_the_true_tilt(run: SimulatedRun) -> None:
    figure = draw_from_above(run)
    colours = next(c.get_array() for c in figure.axes[0].collections if c.get_array() is not None)
    assert np.max(colours) == pytest.approx(np.degrees(np.max(np.abs(run.tilt))), rel=0.1)


def test_the_side_view_takes_the_scan_with_the_most_pitch_and_its_beams_end_on_something(
    run: SimulatedRun,
) -> None:
    figure = draw_from_the_side(run)
    scan = int(np.argmax(run.tilt[:, 1]))
    assert f"scan {scan}:" in figure.axes[0].get_title(loc="left")
    hits = next(c for c in figure.axes[0].collections if c.get_label() == "what the beams met").get_offsets()
    heights = np.asarray(hits)[:, 1]
    assert np.nanmin(heights) > -0.01
    assert np.nanmin(heights) < run.setup.scanner.height, "a laser that looks down sees below its height"


def test_a_log_has_no_world_to_show(run: SimulatedRun) -> None:
    estimates = [Estimate("ins", run.recording.dead_reckoning)]
    names = [[d.name for d in run_specs(run.recording, estimates, [], known)] for known in (None, run)]
    assert names == [["maps", "trajectories"], ["maps", "trajectories", "world", "tilt"]]
