"""Between the frames of two maps and those of their anchors, which alignments are made in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from slam import se2
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch

if TYPE_CHECKING:
    from stitch.command.map_graph import MapGraph


def prior_between(a: Submap, b: Submap, T_a_b: Array, sigma: Array) -> Prior:
    """A guess ``T_a_b (3,)`` of map b in the frame of map a, as a prior between their anchors.

    ``sigma (3,)`` m, m, rad are the standard deviations of its numbers. Raises ``ValueError`` where one is
    not positive or not finite.
    """
    if not (np.all(sigma > 0.0) and np.all(np.isfinite(sigma))):
        raise ValueError(f"expected three standard deviations > 0, got {' '.join(f'{s:g}' for s in sigma)}")
    covariance = se2.to_body_covariance(T_a_b, np.diag(sigma**2))
    T = se2.compose(se2.between(a.anchor, T_a_b), b.anchor)
    return Prior(T, se2.transport(covariance, se2.inverse(b.anchor)))


def between_maps(a: Submap, b: Submap, result: Stitch | NoStitch) -> Stitch | NoStitch:
    """An alignment between the anchors of two submaps as one between their maps."""
    if isinstance(result, NoStitch):
        return replace(result, best=result.best and _moved(a, b, result.best))
    return replace(
        result,
        T_a_b=_pose(a, b, result.T_a_b),
        covariance=None if result.covariance is None else se2.transport(result.covariance, b.anchor),
        alternatives=tuple(_moved(a, b, alternative) for alternative in result.alternatives),
    )


def graph_between_maps(submaps: Sequence[Submap], graph: MapGraph) -> MapGraph:
    """A graph of anchors as one of their maps."""
    members = [submaps[k] for k in graph.members]
    return replace(
        graph,
        poses=np.array([_pose(submaps[0], b, T) for b, T in zip(members, graph.poses, strict=True)]),
        covariances=np.array(
            [se2.transport(sigma, b.anchor) for b, sigma in zip(members, graph.covariances, strict=True)]
        ),
        results={(a, b): between_maps(submaps[a], submaps[b], r) for (a, b), r in graph.results.items()},
    )


def _pose(a: Submap, b: Submap, T: Array) -> Array:
    return se2.compose(se2.compose(a.anchor, T), se2.inverse(b.anchor))


def _moved(a: Submap, b: Submap, alternative: Alternative) -> Alternative:
    return replace(alternative, T_a_b=_pose(a, b, alternative.T_a_b))


def deviations(T_a_b: Array, covariance: Array) -> Array:
    """Standard deviations ``(3,)`` of a pose's x, y and yaw, from its body covariance ``(3, 3)``."""
    R = np.eye(3)
    R[:2, :2] = se2.rotation(T_a_b[2])
    return np.sqrt(np.diag(R @ covariance @ R.T))
