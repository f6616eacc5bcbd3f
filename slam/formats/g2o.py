"""Pose graphs of the plane as g2o files: ``VERTEX_SE2`` and ``EDGE_SE2`` lines, or TORO's ``VERTEX2`` and
``EDGE2``."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from slam.formats.text import File, FormatError, numbers, whole
from slam.graph.pose_graph import PoseGraph, spanning_tree_poses

UPPER = np.triu_indices(3)
"""Order of an edge's information: I11 I12 I13 I22 I23 I33."""
TORO = [0, 1, 2, 3, 4, 7, 5, 8, 6]
"""Where an EDGE2 has what an EDGE_SE2 has: it prints I11 I12 I22 I33 I13 I23."""
VERTICES, EDGES = ("VERTEX_SE2", "VERTEX2"), ("EDGE_SE2", "EDGE2")
INDEFINITE = -1e-6
"""Smallest eigenvalue of an edge's information, as a share of the largest, that rounding explains."""


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

    Without any vertices the poses are those of a spanning tree of the edges, in the order of their numbers.
    Raises `FormatError` naming file and line, also for vertices and edges of other kinds.
    """
    path = Path(path)
    index: dict[str, int] = {}
    poses: list[list[float]] = []
    ends: list[tuple[str, str]] = []
    measurements: list[list[float]] = []
    lines: list[int] = []
    for number, words in File(path).records():
        if words[0] == "FIX":
            continue
        _check_line(words, path, number)
        if words[0] in VERTICES:
            if words[1] in index:
                raise FormatError(f"vertex {words[1][:20]} a second time", path, number)
            index[words[1]] = len(poses)
            poses.append(numbers(words[2:], "vertex", path, number))
        else:
            values = numbers(words[3:], "edge", path, number)
            measurements.append(values if words[0] == "EDGE_SE2" else [values[k] for k in TORO])
            ends.append((words[1], words[2]))
            lines.append(number)
    if not poses and not ends:
        raise FormatError("no VERTEX_SE2 and no EDGE_SE2, expected a pose graph", path)
    if not poses:
        index = _numbered(ends, lines, path)
    edges = np.array([_edge(index, *end, line, path) for end, line in zip(ends, lines, strict=True)])
    edges = edges.astype(np.int64).reshape(-1, 2)
    table = np.array(measurements).reshape(-1, 9)
    information = _symmetric(table[:, 3:])
    _check_information(information, lines, path)
    start = np.array(poses) if poses else spanning_tree_poses(len(index), edges, table[:, :3])
    return PoseGraph(start, edges, table[:, :3], information)


def _check_line(words: list[str], path: Path, line: int) -> None:
    if words[0] not in VERTICES + EDGES:
        raise FormatError(f"{words[0][:30]!r}, expected VERTEX_SE2 or EDGE_SE2", path, line)
    expected = 4 if words[0] in VERTICES else 11
    if len(words) - 1 != expected:
        raise FormatError(f"{words[0]} of {len(words) - 1} values, expected {expected}", path, line)


def _numbered(ends: list[tuple[str, str]], lines: list[int], path: Path) -> dict[str, int]:
    """Index of every vertex that an edge names, in the order of their numbers."""
    number = {
        word: whole(word, "vertex", path, line) for end, line in zip(ends, lines, strict=True) for word in end
    }
    return {word: k for k, word in enumerate(sorted(number, key=number.__getitem__))}


def _edge(index: dict[str, int], a: str, b: str, line: int, path: Path) -> tuple[int, int]:
    for vertex in (a, b):
        if vertex not in index:
            raise FormatError(f"edge to vertex {vertex[:20]}, which is not in the file", path, line)
    return index[a], index[b]


def _check_information(information: np.ndarray, lines: list[int], path: Path) -> None:
    eigenvalues = np.linalg.eigvalsh(information)
    bad = np.flatnonzero(eigenvalues[:, 0] < INDEFINITE * np.maximum(eigenvalues[:, 2], 1.0))
    if len(bad):
        message = "the information of the edge is not positive semi-definite"
        raise FormatError(message, path, lines[bad[0]])


def _symmetric(upper: np.ndarray) -> np.ndarray:
    information = np.zeros((len(upper), 3, 3))
    information[:, UPPER[0], UPPER[1]] = upper
    information[:, UPPER[1], UPPER[0]] = upper
    return information


def _joined(values: list[float]) -> str:
    return " ".join(map(repr, values))
