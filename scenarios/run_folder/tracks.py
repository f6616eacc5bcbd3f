"""tracks.npz: what each front end said of every scan, and how sure each method is of its poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from slam.odometry.track import Track
from stitch.mapping.estimate import Estimate

COVARIANCE = "pose_covariance"
PLAIN = tuple(field.name for field in fields(Track) if field.name != "confidence")
"""Fields of a track that are one array."""


def write(path: Path, estimates: Sequence[Estimate]) -> None:
    """The fields of every track as ``method/field``, its measures as ``method/confidence/name``; the
    covariances of the poses as ``method/pose_covariance``. ``numpy.load(path, allow_pickle=False)`` reads it.
    """
    arrays: dict[str, np.ndarray] = {}
    for estimate in estimates:
        if estimate.covariance is not None:
            arrays[f"{estimate.method}/{COVARIANCE}"] = estimate.covariance
        if estimate.track is not None:
            for name in PLAIN:
                arrays[f"{estimate.method}/{name}"] = getattr(estimate.track, name)
            for name, column in estimate.track.confidence.items():
                arrays[f"{estimate.method}/confidence/{name}"] = column
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read(arrays: Mapping[str, np.ndarray], method: str) -> Track | None:
    """The track of a method, None where it has none."""
    if f"{method}/poses" not in arrays:
        return None
    start = f"{method}/confidence/"
    confidence = {name.removeprefix(start): arrays[name] for name in arrays if name.startswith(start)}
    plain: dict[str, Any] = {name: arrays[f"{method}/{name}"] for name in PLAIN}
    return Track(**plain, confidence=confidence)
