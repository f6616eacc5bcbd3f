"""A short drive that makes every method compile or load its kernels before its time is taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam.recording import Recording

SCANS = 40
"""Scans of the recording's beginning that are driven twice."""
BLIND = 10
"""The last of them are driven blind in between: a failure, so that there is something to cut and to
stitch."""


def warm_up_recording(recording: Recording) -> Recording:
    """The beginning of a recording, a blind gap, and the same beginning again."""
    begin = np.arange(min(SCANS, len(recording)))
    blind = begin[-BLIND:]
    rows = np.concatenate([begin, blind, begin])
    ranges = recording.ranges[rows]
    ranges[len(begin) : len(begin) + len(blind)] = np.nan
    return replace(
        recording,
        time=np.arange(len(rows), dtype=float),
        ranges=ranges,
        dead_reckoning=recording.dead_reckoning[rows],
        attitude=None if recording.attitude is None else recording.attitude[rows],
        odometry=None,
        truth=None,
        relations=None,
    )
