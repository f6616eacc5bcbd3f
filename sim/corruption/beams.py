"""Beams that are lost, or whose ranges are wrong, each by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.corruption.kind import Kind, Severity
from slam.recording import Recording
from slam.se2 import Array


def with_ranges(recording: Recording, ranges: Array) -> Recording:
    """The recording with other ``ranges (N, B)``; what lies beyond the laser's limits did not return."""
    laser = recording.laser
    out = (ranges < laser.range_min) | (ranges >= laser.range_max)
    return replace(recording, ranges=np.where(out, np.nan, ranges))


def drop(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Every beam is lost with the chance ``severity``."""
    lost = rng.random(recording.ranges.shape) < severity
    return replace(recording, ranges=np.where(lost, np.nan, recording.ranges))


def blind(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """For so many scans in a row no beam returns."""
    count, ranges = int(severity), recording.ranges.copy()
    if count >= len(ranges):
        raise ValueError(f"laser.blind={count}: expected a recording of more scans, got {len(ranges)}")
    start = rng.integers(0, len(ranges) - count + 1)
    ranges[start : start + count] = np.nan
    return replace(recording, ranges=ranges)


def add_noise(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Normal noise of the standard deviation ``severity`` m is added to every range."""
    return with_ranges(recording, recording.ranges + rng.normal(0.0, severity, recording.ranges.shape))


def add_bias(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Every range is ``severity`` m longer."""
    return with_ranges(recording, recording.ranges + severity)


def add_outliers(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """A share of the beams that return reports anything up to the longest range of the scan."""
    ranges, shape = recording.ranges, recording.ranges.shape
    wrong = (rng.random(shape) < severity) & np.isfinite(ranges)
    longest = np.max(np.nan_to_num(ranges), axis=1, keepdims=True)
    anything = recording.laser.range_min + rng.random(shape) * (longest - recording.laser.range_min)
    return with_ranges(recording, np.where(wrong, anything, ranges))


def add_dust(recording: Recording, severity: float, rng: np.random.Generator) -> Recording:
    """Beams end at grains of dust, ``severity`` a metre, where one is in the way (Beer–Lambert)."""
    if severity == 0.0:
        return recording
    grain = rng.exponential(1.0 / severity, recording.ranges.shape)
    reach = np.where(np.isfinite(recording.ranges), recording.ranges, recording.laser.range_max)
    return with_ranges(recording, np.where(grain < reach, grain, recording.ranges))


KINDS = (
    Kind(
        "laser.dropped",
        "beams are lost at random",
        drop,
        Severity("share of the beams", "", 0.0, 1.0, (0.2, 0.5, 0.8), 0.5),
    ),
    Kind(
        "laser.blind",
        "scans in a row are without any return",
        blind,
        Severity("how many", "scans", 1.0, 100000.0, (5.0, 15.0, 40.0), 15.0, whole=True),
    ),
    Kind(
        "laser.noise",
        "normal noise is added to the ranges",
        add_noise,
        Severity("standard deviation", "m", 0.0, 10.0, (0.02, 0.05, 0.1), 0.05),
    ),
    Kind(
        "laser.bias",
        "all ranges are too long, or too short where negative",
        add_bias,
        Severity("what is added", "m", -10.0, 10.0, (0.02, 0.05, 0.1), 0.05),
        drawn=False,
    ),
    Kind(
        "laser.outliers",
        "ranges are replaced by random ones",
        add_outliers,
        Severity("share of the returns", "", 0.0, 1.0, (0.05, 0.2, 0.4), 0.2),
    ),
    Kind(
        "laser.dust",
        "beams end at grains of dust",
        add_dust,
        Severity("grains in a metre of beam", "1/m", 0.0, 100.0, (0.02, 0.05, 0.2), 0.05),
    ),
)
"""The entries of this family."""
