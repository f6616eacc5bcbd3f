"""What is told of an alignment: as an object for JSON, and as lines to read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from slam.se2 import Array
from stitch.alignment.result import Alternative, NoStitch, Stitch
from stitch.command.frames import deviations

if TYPE_CHECKING:
    from stitch.command.map_graph import Network


def as_json(answer: Stitch | NoStitch) -> dict[str, Any]:
    """An answer between two maps in m, m² and rad; ``null`` is what there is none of.

    ``std`` are the standard deviations of the three numbers of ``T_a_b``; ``belief`` is the probability that
    they are right at all, as of simulated pairs like these; ``alternatives`` are the other
    candidates, best first; of a refusal all of them are, the best one too.
    """
    if isinstance(answer, NoStitch):
        nothing = dict.fromkeys(("T_a_b", "std", "overlap_m2", "agreement", "margin"))
        best = [] if answer.best is None else [answer.best]
        return {
            "accepted": False,
            **nothing,
            "reason": answer.reason,
            "alternatives": _listed(best),
            "belief": None,
        }
    return {
        "accepted": True,
        "T_a_b": answer.T_a_b.tolist(),
        "std": None if answer.covariance is None else deviations(answer.T_a_b, answer.covariance).tolist(),
        "overlap_m2": answer.overlap_area,
        "agreement": answer.agreement,
        "margin": margin(answer),
        "reason": None,
        "alternatives": _listed(answer.alternatives),
        "belief": None if answer.belief is None else _probability(answer.belief),
    }


def network_json(network: Network, names: Sequence[str]) -> dict[str, Any]:
    """Many maps joined: where each lies in the frame of the first, and every pair that was tried."""
    joined = len(network.members) > 1
    placed = zip(network.members, network.poses, network.covariances, strict=True)
    return {
        "accepted": joined,
        "reason": None if joined else f"no map could be joined to {names[0]}",
        "maps": [
            {"map": names[k], "T_first_map": T.tolist(), "std": deviations(T, sigma).tolist()}
            for k, T, sigma in placed
        ],
        "left_out": [name for k, name in enumerate(names) if k not in network.members],
        "pairs": [
            {"a": names[a], "b": names[b], **as_json(result), "used": (a, b) in network.trusted}
            for (a, b), result in network.results.items()
        ],
    }


def _probability(log_odds: float) -> float:
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def _listed(alternatives: list[Alternative] | tuple[Alternative, ...]) -> list[dict[str, Any]]:
    return [{"T_a_b": other.T_a_b.tolist(), "score": other.score} for other in alternatives]


def margin(stitch: Stitch) -> float | None:
    """What the runner-up lacks of the best score, as a share of it; None without a runner-up."""
    if not stitch.alternatives or not stitch.score > 0.0:
        return None
    return 1.0 - stitch.alternatives[0].score / stitch.score


def in_words(T_a_b: Array) -> str:
    """A pose in one line, in m and degrees."""
    return f"x {T_a_b[0]:.3f} m, y {T_a_b[1]:.3f} m, yaw {np.degrees(T_a_b[2]):.2f}°"


def as_text(stitch: Stitch, a: str, b: str) -> str:
    """The stitch of map ``b`` to map ``a``, one line for each thing to know."""
    std = None if stitch.covariance is None else deviations(stitch.T_a_b, stitch.covariance)
    numbers = zip(("x", "y", "yaw"), stitch.T_a_b, "mm°", [None] * 3 if std is None else std, strict=True)
    lines = [f"{b} in the frame of {a}"]
    for name, value, unit, sigma in numbers:
        factor = 180.0 / np.pi if unit == "°" else 1.0
        spread = "" if sigma is None else f" ± {factor * sigma:.3f}"
        exactly = f"   ({value:.5f} rad)" if unit == "°" else ""
        lines.append(f"  {name:<9} {factor * value:10.3f}{spread} {unit}{exactly}")
    if std is None:
        lines.append("  the method tells nothing of how sure it is")
    lines.append(f"  overlap   {stitch.overlap_area:10.1f} m²")
    lines.append(f"  agreement {stitch.agreement:10.2f} of the walls in the overlap are in both maps")
    if stitch.belief is not None:
        lines.append(f"  belief    {100.0 * _probability(stitch.belief):10.1f} % that it is right at all")
    left = margin(stitch)
    rival = "none" if left is None else f"{in_words(stitch.alternatives[0].T_a_b)}, margin {left:.2f}"
    lines.append(f"  runner-up {rival}")
    return "\n".join(lines)
