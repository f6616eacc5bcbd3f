"""False stitches put among the true ones: what does the graph make of them?"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from slam import se2
from slam.recording import Recording
from slam.se2 import Array
from stitch.align import Stitch
from stitch.mapping import Estimate, LoopCandidate, MappingConfig, NoEstimate, map_recording
from stitch.mapping.loop_closure import LoopClosureResult
from stitch.mapping.submap_graph import LoopConfig, add_stitches, optimise_robustly, with_weights

OFFSET = (1.0, 5.0)
"""A false stitch lies this far [m] from where the graph has its submap, turned by any angle."""


def map_with_false_stitches(
    recording: Recording, config: MappingConfig, share: float, rng: np.random.Generator
) -> Estimate | NoEstimate:
    """`map_recording`, of whose stitches a ``share`` is made up."""
    revise = partial(inject_false_stitches, share=share, config=config.loops, rng=rng)
    return map_recording(recording, config, revise)


def inject_false_stitches(
    closed: LoopClosureResult, start: Array, share: float, config: LoopConfig, rng: np.random.Generator
) -> LoopClosureResult:
    """The loops with so many false ones among them that these are a ``share``, judged anew from the poses
    ``start (L, 3)``. Without any stitch nothing is injected. Raises ``ValueError`` for a share outside 0..1.
    """
    if not 0.0 <= share < 1.0:
        raise ValueError(f"share of false stitches: expected at least 0 and below 1, got {share}")
    true = [c.result for c in closed.tried if isinstance(c.result, Stitch)]
    if not true:
        return closed
    count = round(len(true) * share / (1.0 - share))
    poses = closed.poses if closed.nodes is None else closed.poses[closed.nodes]
    false = []
    for _ in range(count):
        a, b = sorted(rng.choice(len(poses), 2, replace=False).tolist())
        distance, (bearing, yaw) = rng.uniform(*OFFSET), rng.uniform(-np.pi, np.pi, 2)
        offset = np.array([distance * np.cos(bearing), distance * np.sin(bearing), yaw])
        T_a_b = se2.compose(se2.between(poses[a], poses[b]), offset)
        false.append(((a, b), replace(true[int(rng.integers(len(true)))], T_a_b=T_a_b)))
    graph = add_stitches(closed.graph, false, closed.nodes)
    solution = optimise_robustly(replace(graph, poses=start), config)
    tried = (*closed.tried, *(LoopCandidate(a, b, stitch) for (a, b), stitch in false))
    return replace(closed, graph=graph, poses=solution.poses, tried=with_weights(tried, solution.weights))
