"""A drive tracked by ManifoldSLAM: every measure of every step, and which steps were truly lost."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from scenarios.evaluation.segmentation import true_errors
from slam.mapping.occupancy import Grid
from slam.odometry.track import Track
from slam.recording import Recording
from slam.scan import Scan
from slam.se2 import Array


@dataclass(frozen=True)
class LabelledDrive:
    """A recording with truth, its scans without co-moving points, the track of ManifoldSLAM's front end (ours
    is hardly ever lost), and the map drawn with true poses."""

    recording: Recording
    scans: list[Scan]
    track: Track
    true_map: Grid


@dataclass(frozen=True)
class Steps:
    """The M steps of a track that were tried: ``scan (M,)``, ``error (M,)`` in units of a failure, and every
    measure ``(M,)`` by name, +inf where nothing matched and NaN where it could not be measured."""

    scan: np.ndarray
    error: Array
    columns: dict[str, Array]

    @property
    def lost(self) -> np.ndarray:
        """Steps ``(M,)`` bool that are off by more than a failure."""
        return self.error > 1.0

    @property
    def matched(self) -> np.ndarray:
        """Steps ``(M,)`` bool with at least one match."""
        return np.isfinite(self.columns["neg_matches"])

    def of(self, name: str, part: np.ndarray) -> tuple[Array, np.ndarray] | None:
        """Values of a measure and what was lost, of some of the steps; None where it was not measured."""
        values = self.columns[name][part]
        return None if np.isnan(values).any() else (values, self.lost[part])

    def to_bytes(self) -> bytes:
        """The steps as an .npz file."""
        file = io.BytesIO()
        arrays = {"scan": self.scan, "error": self.error, **self.columns}
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        return file.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> Steps:
        """What `to_bytes` wrote."""
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            arrays = dict(stored)
        return cls(arrays.pop("scan"), arrays.pop("error"), arrays)


def label_drive(scenario: str, seed: int) -> LabelledDrive:
    """Simulate a drive and let ManifoldSLAM track it, once for all trials of the drive."""
    from scenarios.evaluation.maps import true_map
    from scenarios.source import simulated
    from slam.odometry.ego_motion_filter import remove_co_moving_points
    from slam.odometry.tracker import MANIFOLD_SLAM, track
    from slam.scan import scans_of

    recording = simulated(scenario, seed).recording
    scans = remove_co_moving_points(recording, scans_of(recording))
    drawn = true_map(recording)
    assert drawn is not None
    return LabelledDrive(recording, scans, track(recording, MANIFOLD_SLAM, scans), drawn)


def steps_of(recording: Recording, track: Track) -> Steps:
    """The steps of a track. Raises ``ValueError`` for a recording without truth."""
    errors = true_errors(track, recording)
    rows = np.flatnonzero(np.isfinite(errors))
    return Steps(rows, errors[rows], {name: values[rows] for name, values in track.confidence.items()})
