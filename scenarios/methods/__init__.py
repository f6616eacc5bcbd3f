"""The methods that are compared: each turns a recording into an estimate. Only the oracle sees the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.estimate import Estimate
    from scenarios.methods.config import MethodConfig
    from slam.recording import Recording

Method = Callable[["Recording", "MethodConfig"], "Estimate"]


def ins(recording: Recording, config: MethodConfig) -> Estimate:
    """Dead reckoning exactly as recorded."""
    from scenarios.estimate import Estimate

    return Estimate("ins", recording.dead_reckoning)


def icp(recording: Recording, config: MethodConfig) -> Estimate:
    """Unweighted point-to-point ICP, scan to scan, in our front end."""
    from scenarios.estimate import Estimate
    from slam.frontend import track

    found = track(recording, config.icp)
    return Estimate("icp", found.poses, track=found)


def wsm(recording: Recording, config: MethodConfig) -> Estimate:
    """ManifoldSLAM with the Weighted Scan Matcher, as the report ran it."""
    from scenarios.estimate import Estimate
    from slam.frontend import track

    found = track(recording, config.manifold)
    return Estimate("wsm", found.poses, track=found)


def htms(recording: Recording, config: MethodConfig) -> Estimate:
    """The report's Hough-transform based map stitching of the pieces of ManifoldSLAM's map."""
    from scenarios.methods.htms import stitch_in_sequence

    return stitch_in_sequence(recording, config)


def slamstitch(recording: Recording, config: MethodConfig) -> Estimate:
    """Ours: local maps, cuts, joint stitching, a robust pose graph and a bundle."""
    from scenarios.methods.slamstitch import run

    return run(recording, config)


def oracle(recording: Recording, config: MethodConfig) -> Estimate:
    """Ours with the true cuts and the true loop closures: what is left to gain."""
    from scenarios.methods.oracle import run

    return run(recording, config)


METHODS: dict[str, Method] = {method.__name__: method for method in (ins, icp, wsm, htms, slamstitch, oracle)}
"""Name → method."""

SEES_TRUTH = ("oracle",)
"""Methods that refuse a recording without truth."""

FAIR: tuple[str, ...] = tuple(name for name in METHODS if name not in SEES_TRUTH)
"""Methods that know what a robot knows: those that run when nobody asks for others."""

REHEARSED_AS = {"oracle": "slamstitch"}
"""A rehearsal knows no truth: who loads the kernels of a method that sees it."""
