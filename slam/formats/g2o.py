"""Pose graphs of the plane as g2o files: ``VERTEX_SE2`` and ``EDGE_SE2`` lines."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from slam.formats.text import File, FormatError, numbers
from slam.graph.pose_graph import PoseGraph

UPPER = np.triu_indices(3)
"""Order of an edge's information: I11 I12 I13 I22 I23 I33."""
LENGTHS = {"VERTEX_SE2": 5, "EDGE_SE2": 12}


def write(path: str | PathLike[str], graph: PoseGraph) -> None:
    """Write a graph, every digit; poses are numbered from 0."""
    lines = []
    for index, pose in enumerate(graph.poses.tolist()):
        lines.append(f"VERTEX_SE2 {index} {_joined(pose)}\n")
    upper = graph.information[:, UPPER[0], UPPER[1]]
    for (i, j), T_ij, information in zip(
        graph.edges.tolist(), graph.T_ij.tolist(), upper.tolist(), strict=True
    ):
        lines.append(f"EDGE_SE2 {i} {j} {_joined(T_ij)} {_joined(information)}\n")
    Path(path).write_text("".join(lines), encoding="utf-8")


def read(path: str | PathLike[str]) -> PoseGraph:
    """Read a graph; poses keep the file's order, edges index into it whatever the file's numbering.

    Raises `FormatError` naming file and line, also for vertices and edges of other kinds.
    """
    path = Path(path)
    index: dict[str, int] = {}
    poses: list[list[float]] = []
    ends: list[tuple[str, str, int]] = []
    measurements: list[list[float]] = []
    for number, words in File(path).records():
        if words[0] == "FIX":
            continue
        _check_line(words, path, number)
        if words[0] == "VERTEX_SE2":
            if words[1] in index:
                raise FormatError(f"vertex {words[1][:20]} a second time", path, number)
            index[words[1]] = len(poses)
            poses.append(numbers(words[2:], "vertex", path, number))
        else:
            ends.append((words[1], words[2], number))
            measurements.append(numbers(words[3:], "edge", path, number))
    if not poses:
        raise FormatError("no VERTEX_SE2, expected a pose graph", path)
    edges = np.array([_edge(index, *end, path) for end in ends], dtype=np.int64).reshape(-1, 2)
    table = np.array(measurements).reshape(-1, 9)
    return PoseGraph(np.array(poses), edges, table[:, :3], _symmetric(table[:, 3:]))


def _check_line(words: list[str], path: Path, line: int) -> None:
    if words[0] not in LENGTHS:
        raise FormatError(f"{words[0][:30]!r}, expected VERTEX_SE2 or EDGE_SE2", path, line)
    if len(words) != LENGTHS[words[0]]:
        expected = LENGTHS[words[0]] - 1
        raise FormatError(f"{words[0]} of {len(words) - 1} values, expected {expected}", path, line)


def _edge(index: dict[str, int], a: str, b: str, line: int, path: Path) -> tuple[int, int]:
    for vertex in (a, b):
        if vertex not in index:
            raise FormatError(f"edge to vertex {vertex[:20]}, which is not in the file", path, line)
    return index[a], index[b]


def _symmetric(upper: np.ndarray) -> np.ndarray:
    information = np.zeros((len(upper), 3, 3))
    information[:, UPPER[0], UPPER[1]] = upper
    information[:, UPPER[1], UPPER[0]] = upper
    return information


def _joined(values: list[float]) -> str:
    return " ".join(map(repr, values))
