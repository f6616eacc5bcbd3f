"""Where a recording comes from: a scenario of the catalogue, simulated, or a log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.catalogue import CATALOGUE
from scenarios.cli import BadInput, nearest

if TYPE_CHECKING:
    from slam.recording import Recording


@dataclass(frozen=True)
class Peer:
    """Another system's published answer for a log: one pose per scan."""

    name: str
    path: Path


def is_scenario(target: str) -> bool:
    """True when ``target`` names a scenario rather than a file.

    Raises `BadInput` for a name that is neither, with the nearest scenario.
    """
    if target in CATALOGUE:
        return True
    if Path(target).exists():
        return False
    if Path(target).suffix or len(Path(target).parts) > 1:
        raise BadInput(f"{target}: no such file, expected a recording (USARSim, CARMEN or recording.npz)")
    raise BadInput(f"unknown scenario {target!r}: {nearest(target, CATALOGUE)}")


def simulated(name: str, seed: int) -> Recording:
    """A drive through a scenario of the catalogue."""
    from sim.record import simulate

    return simulate(CATALOGUE[name], seed).recording


def logged(path: Path, relations: Path | None, mount: tuple[float, float, float] | None) -> Recording:
    """A recording from a log, with the relations to score it against and the laser mount the user knows better.

    Raises `slam.formats.FormatError` for what cannot be read and `BadInput` for relations that match nothing.
    """
    import numpy as np

    from scenarios.evaluation.relations import relation_pairs
    from slam.formats import load

    recording = load(path, relations)
    if mount is not None:
        if not np.all(np.isfinite(mount)):
            raise BadInput(f"--laser-mount: expected three finite numbers x y yaw, got {mount}")
        recording = recording.with_laser_mount(np.array(mount))
    try:
        relation_pairs(recording)
    except ValueError as error:
        raise BadInput(f"{relations}: {error}") from error
    return recording


def peers(path: Path) -> list[Peer]:
    """Answers of other systems that lie beside a log: ``intel.raw.log.gz`` finds ``intel.gmapping_ref.txt``."""
    stem = path.name.split(".")[0]
    found = sorted(path.parent.glob(f"{stem}.*_ref.txt"))
    return [Peer(f"{file.name.split('.')[1].removesuffix('_ref')} (published)", file) for file in found]
