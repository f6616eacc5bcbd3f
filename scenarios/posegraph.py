"""python -m scenarios.posegraph GRAPH.g2o: a pose graph that others made, optimised."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from slam.cli import InputError, main

if TYPE_CHECKING:
    from slam.graph.pose_graph import PoseGraph, Solution

COMMAND = "scenarios.posegraph"


@dataclass(frozen=True)
class Options:
    """Optimise a pose graph of the plane, and print its χ² before and after.

    A graph without poses begins with those of a spanning tree of its edges.
    """

    graph: Positional[Annotated[Path, arg(metavar="GRAPH.g2o")]]
    """g2o file of VERTEX_SE2 and EDGE_SE2 lines, or TORO's VERTEX2 and EDGE2."""
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="FILE", help_behavior_hint="")] = None
    """Where to write the graph with its optimised poses."""


def run(options: Options) -> None:
    """Read, optimise, tell, and write."""
    from slam.formats import g2o
    from slam.graph.pose_graph import anchors, chi_squared

    if options.out is not None and not options.out.parent.is_dir():
        raise InputError(f"--out {options.out}: {options.out.parent} is no folder")
    graph, solution = solve(options.graph)
    before, after = (chi_squared(graph, poses).sum() for poses in (graph.poses, solution.poses))
    print(f"{len(graph.poses)} poses, {len(graph.edges)} edges: chi-squared {before:.6g} -> {after:.6g}")
    if solution.note:
        print(solution.note)
    if (parts := len(anchors(graph))) > 1:
        print(f"{parts} parts that no edge connects: each keeps its first pose")
    if options.out is not None:
        try:
            g2o.write(options.out, replace(graph, poses=solution.poses))
        except OSError as error:
            raise InputError(f"--out {options.out}: cannot be written: {error.strerror}") from error
        print(options.out)


def solve(path: Path) -> tuple[PoseGraph, Solution]:
    """The graph in a file, and its poses optimised. Raises `InputError`."""
    from slam.formats import FormatError, g2o
    from slam.graph.pose_graph import optimise

    try:
        graph = g2o.read(path)
        return graph, optimise(graph, "none")
    except FormatError as error:
        raise InputError(str(error)) from error
    except (ValueError, RuntimeError) as error:  # gtsam's exceptions become RuntimeErrors
        raise InputError(f"{path}: {error}") from error


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))
