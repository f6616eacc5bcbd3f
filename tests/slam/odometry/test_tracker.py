"""The tracker, scan by scan: what it cannot know, and what it keeps."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slam.odometry.tracker import MANIFOLD_SLAM, FrontendConfig, Tracker, track
from slam.recording import Recording
from slam.scan import scans_of
from slam.se2 import Array

Record = Callable[..., Recording]
Drive = Callable[..., Array]

CONFIGS = {"default": FrontendConfig(), "manifold": MANIFOLD_SLAM}


@pytest.mark.parametrize("name", CONFIGS)
def test_a_step_sees_nothing_of_what_comes_later(
    room: Array, record: Record, curve: Drive, name: str
) -> None:
    truth = curve()
    reckoned = np.column_stack([truth[:, :2], 1.15 * truth[:, 2]])
    recording = record(room, truth, reckoned, source="ins")
    whole = track(recording, CONFIGS[name])
    tracker = Tracker(recording, CONFIGS[name], room=4)
    for k, scan in enumerate(scans_of(recording)[:12]):
        tracker.step(scan)
        np.testing.assert_array_equal(tracker.poses, whole.poses[: k + 1])
    part = tracker.track(since=4)
    np.testing.assert_array_equal(part.poses, whole.poses[4:12])
    np.testing.assert_array_equal(part.verdict, whole.verdict[4:12])
    for measure, column in part.confidence.items():
        np.testing.assert_array_equal(column, whole.confidence[measure][4:12])


def test_memory_does_not_grow_with_the_drive(room: Array, record: Record, straight: Drive) -> None:
    loop = np.concatenate([straight(), straight()[::-1]])
    recording = record(room, np.tile(loop, (8, 1)))
    short = replace(recording, **_cut(recording, 300))

    def peak(drive: Recording) -> int:
        tracemalloc.start()
        track(drive)
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size

    track(replace(short, **_cut(short, 10)))  # loads what stays loaded
    per_scan = (peak(recording) - peak(short)) / (len(recording) - len(short))
    assert per_scan < 2500  # its row of the track: pose, covariances, information and measures


def _cut(recording: Recording, n: int) -> dict[str, object]:
    """The first n scans' worth of everything that has one row for each."""
    return {name: getattr(recording, name)[:n] for name in ("time", "ranges", "dead_reckoning", "truth")}
