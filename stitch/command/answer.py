"""What the command says of an alignment: an object for JSON, lines to read, a table of many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from slam.se2 import Array
from slam.table import Table, number
from stitch.alignment.result import NoStitch, Stitch
from stitch.command.frames import deviations

if TYPE_CHECKING:
    from stitch.command.map_graph import MapGraph

COLUMNS = (
    "map",
    "in the frame of",
    "verdict",
    "x [m]",
    "y [m]",
    "yaw [°]",
    "overlap [m²]",
    "agreement",
    "margin",
)


def as_json(result: Stitch | NoStitch) -> dict[str, Any]:
    """An alignment of two maps in m, m² and rad; ``null`` is what there is none of.

    ``std`` are the standard deviations of the three numbers of ``T_a_b``; ``belief`` is the probability that
    they are right at all, as of simulated pairs like these; ``alternatives`` are the other candidates, best
    first; of a refusal all of them are, the best one too.
    """
    content: dict[str, Any] = {"accepted": isinstance(result, Stitch)}
    content |= dict.fromkeys(("T_a_b", "std", "overlap_m2", "agreement", "margin", "reason"))
    if isinstance(result, NoStitch):
        content["reason"], belief = result.reason, None
        others = [] if result.best is None else [result.best]
    else:
        others, belief = list(result.alternatives), result.belief
        content["T_a_b"] = result.T_a_b.tolist()
        if result.covariance is not None:
            content["std"] = deviations(result.T_a_b, result.covariance).tolist()
        content["overlap_m2"], content["agreement"] = result.overlap_area, result.agreement
        content["margin"] = margin(result)
    content["alternatives"] = [{"T_a_b": other.T_a_b.tolist(), "score": other.score} for other in others]
    return content | {"belief": None if belief is None else _probability(belief)}


def graph_json(graph: MapGraph, names: Sequence[str]) -> dict[str, Any]:
    """Many maps joined: where each lies in the frame of the first, and every pair that was tried."""
    joined = len(graph.members) > 1
    maps = zip(graph.members, graph.poses, graph.covariances, strict=True)
    return {
        "accepted": joined,
        "reason": None if joined else f"no map could be joined to {names[0]}",
        "maps": [
            {"map": names[k], "T_first_map": T.tolist(), "std": deviations(T, sigma).tolist()}
            for k, T, sigma in maps
        ],
        "left_out": [name for k, name in enumerate(names) if k not in graph.members],
        "pairs": [
            {"a": names[a], "b": names[b], **as_json(result), "used": (a, b) in graph.trusted}
            for (a, b), result in graph.results.items()
        ],
    }


def _probability(log_odds: float) -> float:
    return float(1.0 / (1.0 + np.exp(-log_odds)))


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
    lead = margin(stitch)
    rival = in_words(stitch.alternatives[0].T_a_b) if stitch.alternatives else "none"
    lines.append(f"  runner-up {rival}" + ("" if lead is None else f", margin {lead:.2f}"))
    return "\n".join(lines)


def pairs_table(graph: MapGraph, names: Sequence[str]) -> Table:
    """Every pair of maps tried, given between the maps, with the reasons against as notes."""
    rows, notes = [], []
    for (a, b), result in graph.results.items():
        if isinstance(result, NoStitch):
            rows.append((names[b], names[a], "no", *[""] * 6))
            notes.append(f"{names[b]} in {names[a]}: no: {result.reason}")
            continue
        trusted = (a, b) in graph.trusted
        if not trusted:
            notes.append(f"{names[b]} in {names[a]}: not used: contradicted, or apart from the first map")
        x, y, yaw = result.T_a_b
        rows.append(
            (
                names[b],
                names[a],
                "joined" if trusted else "not used",
                *(number(x), number(y), number(np.degrees(yaw), 2), number(result.overlap_area, 1)),
                *(number(result.agreement, 2), number(margin(result), 2)),
            )
        )
    return Table(COLUMNS, rows, names=3, notes=notes)
