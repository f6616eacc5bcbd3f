"""The warm-up must reach what the methods do, or compiling ends up on somebody's bill."""

from __future__ import annotations

import numpy as np

from scenarios.methods import METHODS
from scenarios.methods.config import MethodConfig
from scenarios.methods.warm_up import BLIND, SCANS, warm_up_recording
from sim.laser import Raycaster
from slam import se2
from slam.recording import Laser, Recording
from stitch.mapping import Estimate

ROOM = np.array(
    [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [2, 1, 3, 1], [3, 1, 3, 2]], dtype=float
)


def straight_drive(scans: int) -> Recording:
    """A robot crosses a room with perfect dead reckoning."""
    poses = np.stack([np.linspace(1.0, 4.5, scans), np.full(scans, 2.8), np.zeros(scans)], axis=1)
    angles = np.linspace(-2.0, 2.0, 120)
    ranges = Raycaster.from_segments(ROOM).cast(poses, angles)
    return Recording(
        "room", np.arange(scans, dtype=float), ranges, angles, Laser(), poses, "ins", truth=poses
    )


def test_it_is_short_blind_in_the_middle_and_knows_no_truth() -> None:
    drive = straight_drive(100)
    short = warm_up_recording(drive)
    assert len(short) == 2 * SCANS + BLIND
    blind = np.all(np.isnan(short.ranges), axis=1)
    np.testing.assert_array_equal(np.flatnonzero(blind), SCANS + np.arange(BLIND))
    assert short.truth is None
    assert not np.any(np.all(np.isnan(drive.ranges), axis=1)), "the recording itself is left alone"


def test_a_recording_shorter_than_the_warm_up_recording() -> None:
    assert len(warm_up_recording(straight_drive(5))) == 3 * 5


def test_it_makes_slamstitch_and_htms_stitch() -> None:
    short = warm_up_recording(straight_drive(60))
    for method in ("htms", "slamstitch"):
        estimate = METHODS[method](short, MethodConfig())
        assert isinstance(estimate, Estimate)
        assert len(estimate.submaps) >= 2
        assert len(estimate.stitches) >= 1
        np.testing.assert_allclose(se2.wrap(estimate.poses[:, 2]), 0.0, atol=0.2)
