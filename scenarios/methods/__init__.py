"""The methods that are compared: each turns a recording into an estimate. Only the oracle sees the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.methods.config import MethodConfig
    from slam.recording import Recording
    from stitch.mapping.estimate import Estimate, NoEstimate

Method = Callable[["Recording", "MethodConfig"], "Estimate"]


def ins(recording: Recording, config: MethodConfig) -> Estimate:
    """Dead reckoning exactly as recorded."""
    from stitch.mapping.estimate import Estimate

    _refuse_without_dead_reckoning("ins", recording)
    return Estimate("ins", recording.dead_reckoning)


def icp(recording: Recording, config: MethodConfig) -> Estimate:
    """Unweighted point-to-point ICP, scan to scan, in our front end."""
    from slam.odometry.tracker import track
    from stitch.mapping.estimate import Estimate

    found = track(recording, config.icp)
    return Estimate("icp", found.poses, track=found)


def wsm(recording: Recording, config: MethodConfig) -> Estimate:
    """ManifoldSLAM with the Weighted Scan Matcher, as the report ran it."""
    from slam.odometry.tracker import track
    from stitch.mapping.estimate import Estimate

    _refuse_without_dead_reckoning("wsm", recording)
    found = track(recording, config.manifold)
    return Estimate("wsm", found.poses, track=found)


def htms(recording: Recording, config: MethodConfig) -> Estimate:
    """The report's Hough-transform based map stitching of the pieces of ManifoldSLAM's map."""
    from scenarios.methods.htms import stitch_in_sequence

    _refuse_without_dead_reckoning("htms", recording)
    return stitch_in_sequence(recording, config)


def slamstitch(recording: Recording, config: MethodConfig) -> Estimate:
    """Ours: local maps, cuts, joint stitching, a robust pose graph and a bundle."""
    from stitch.mapping.offline import run

    return run(recording, config)


def slamstitch_online(recording: Recording, config: MethodConfig) -> Estimate:
    """Ours scan by scan: each pose from the scans until then, by iSAM2."""
    from stitch.mapping.online import run

    return run(recording, config)


def oracle(recording: Recording, config: MethodConfig) -> Estimate:
    """Ours with the true cuts and the true loop closures: what is left to gain."""
    from scenarios.methods.oracle import run

    return run(recording, config)


METHODS: dict[str, Method] = {
    method.__name__: method for method in (ins, icp, wsm, htms, slamstitch, slamstitch_online, oracle)
}
"""Name → method."""

SEES_TRUTH = ("oracle",)
"""Methods that refuse a recording without truth."""

ONLINE = "slamstitch_online"
"""The method that answers scan by scan."""

FAIR: tuple[str, ...] = tuple(name for name in METHODS if name not in (*SEES_TRUTH, ONLINE))
"""Methods that know what a robot knows: those that run when nobody asks for others."""

NEEDS_DEAD_RECKONING = {
    "ins": "the recording has no dead reckoning",
    "wsm": "ManifoldSLAM starts every match at the dead-reckoned pose, and the recording has none",
    "htms": "it stitches ManifoldSLAM's map, which needs dead reckoning, and the recording has none",
}
"""Methods that have no answer for a recording without dead reckoning, and why."""

LEAST_MATCHED = 0.5
"""Share of the scans that must have been matched where nothing else tells how the robot moved."""

MOST_DOUBT = 0.5
"""Standard deviation [m] in its worst direction up to which, in the median, a map without dead reckoning is
one; a map that is right has had 0.3 m and less, one that is lost in a corridor 0.7 m and more."""

REHEARSED_AS = {"oracle": "slamstitch"}
"""A rehearsal knows no truth: who loads the kernels of a method that sees it."""


def answer(name: str, recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
    """What a method says of a recording, or why it has nothing to say."""
    from stitch.mapping.estimate import NoEstimate

    if recording.source != "none":
        return METHODS[name](recording, config)
    if name in NEEDS_DEAD_RECKONING:
        return NoEstimate(name, NEEDS_DEAD_RECKONING[name])
    found = METHODS[name](recording, config)
    reason = hopeless(found)
    return found if reason is None else NoEstimate(name, reason)


def hopeless(found: Estimate) -> str | None:
    """Why an estimate from the laser alone is no answer, None where it is one."""
    import numpy as np

    share = 1.0 if found.track is None else found.track.matched_share
    if share < LEAST_MATCHED:
        least = f"less than the {LEAST_MATCHED:.0%} it takes to map a drive without dead reckoning"
        return f"{share:.0%} of the scans could be matched, {least}"
    if found.covariance is None:
        return None
    largest = np.linalg.eigvalsh(found.covariance[:, :2, :2])[:, -1]
    doubt = float(np.sqrt(np.median(largest)))
    if doubt <= MOST_DOUBT:
        return None
    return (
        f"half of the scans are known to no better than {doubt:.1f} m by the laser alone, expected at most "
        f"{MOST_DOUBT:.1f} m (along a bare corridor it does not tell how far the robot went)"
    )


def _refuse_without_dead_reckoning(name: str, recording: Recording) -> None:
    from slam.cli import InputError

    if recording.source == "none":
        raise InputError(f"{name}: {NEEDS_DEAD_RECKONING[name]}")
