"""Carpin's map merging by Hough spectra and an acceptance index.

S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25, 2008.
"""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.config import AlignConfig
from stitch.alignment.hough import reason_against_directions
from stitch.alignment.raster import Raster, common_windows, lattice_window, look_up
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.published.htms import hypotheses_by_spectra
from stitch.published.pair import Pair, near


def align_carpin(a: Submap, b: Submap, prior: Prior | None, config: AlignConfig) -> Stitch | NoStitch:
    """The hypothesis with the best acceptance index ω, which is its score.

    A prior excludes hypotheses, no more. The threshold on ω and the refusal of maps without two directions
    are ours.
    """
    settings, maps = config.carpin, Pair(a, b, config)
    spectra = maps.spectra(settings.n_theta, split=False)
    reason = reason_against_directions(*spectra, config.directions)
    if reason is not None:
        return NoStitch(reason)
    cells_a = redraw(a.grid, np.zeros(3), config.resolution)
    candidates = [
        Alternative(c.T_a_b, acceptance_index(cells_a, redraw(b.grid, c.T_a_b, config.resolution)))
        for c in hypotheses_by_spectra(maps, spectra, settings.n_peaks)
    ]
    candidates.sort(key=lambda candidate: -candidate.score)
    allowed = near(candidates, prior, config)
    if not allowed:
        return NoStitch(f"none of {len(candidates)} hypotheses is near the prior", candidates[0])
    omega, least = allowed[0].score, settings.min_acceptance_index
    if omega < least:
        return NoStitch(f"acceptance index {omega:.3g}, expected at least {least}", allowed[0])
    return maps.stitch(allowed[0], allowed[1:])


def acceptance_index(a: Raster, b: Raster) -> float:
    """``ω = agree / (agree + disagree)`` of two maps on one lattice, 0 where they do not overlap.

    Cells agree when both are occupied or both free, disagree when one is occupied and the other free; what
    either does not know does not count.
    """
    windows = common_windows(a, b)
    if windows is None:
        return 0.0
    occupied_a, free_a = a.occupied[windows[0]], a.free[windows[0]]
    occupied_b, free_b = b.occupied[windows[1]], b.free[windows[1]]
    agree = np.sum(occupied_a & occupied_b) + np.sum(free_a & free_b)
    disagree = np.sum(occupied_a & free_b) + np.sum(free_a & occupied_b)
    return float(agree / max(agree + disagree, 1))


def redraw(grid: Grid, T: Array, resolution: float) -> Raster:
    """A grid moved by ``T (3,)`` onto the lattice of ``resolution`` m, with nothing left out.

    A cell is occupied when the grid is at its centre (walls keep closed when cells get finer) or when the
    centre of an occupied cell falls into it (walls are not lost when they get coarser).
    """
    first, shape = lattice_window(grid, T, resolution)
    occupied, free = (
        look_up(cells, grid.origin, grid.resolution, T, first, shape, resolution)
        for cells in (grid.occupied, grid.free)
    )
    column, row = (np.floor(se2.transform(T, grid.occupied_points()) / resolution) - first).astype(int).T
    # a centre on the border may round to either side of it
    occupied[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = True
    return Raster(occupied, free & ~occupied, first, resolution)
