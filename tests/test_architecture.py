"""The house: dependencies point one way, scenarios → sim, stitch → slam, and there is no circle."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MAY_IMPORT = {
    "slam": {"slam"},
    "stitch": {"stitch", "slam"},
    "sim": {"sim", "slam"},
    "scenarios": {"scenarios", "sim", "stitch", "slam"},
}
"""Package → the packages of ours that it may import, wherever in a file."""


def modules() -> dict[str, Path]:
    """Every module of the four packages by its dotted name."""
    found = {}
    for package in MAY_IMPORT:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def type_checking(tree: ast.Module) -> set[ast.AST]:
    """Imports that only the type checker makes."""
    return {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }


def imports_of(path: Path, known: dict[str, Path], typing: bool = False) -> set[str]:
    """Modules of ours that a file imports, inside functions too; those for ``typing`` alone only if asked."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    left_out = set() if typing else type_checking(tree)
    found = set()
    for node in ast.walk(tree):
        if node in left_out:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            modules = inner & known.keys()
            found |= modules | ({node.module} if inner - modules else set())
    return found & known.keys()


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_no_arrow_points_back(package: str) -> None:
    known = modules()
    back = {
        f"{name} imports {other}"
        for name, path in known.items()
        if name.split(".")[0] == package
        for other in imports_of(path, known, typing=True)
        if other.split(".")[0] not in MAY_IMPORT[package]
    }
    assert not back


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Every circle that a walk along the arrows finds, as the names on the way."""
    found: list[list[str]] = []
    done: set[str] = set()

    def walk(name: str, way: list[str]) -> None:
        if name in way:
            found.append([*way[way.index(name) :], name])
        elif name not in done:
            for other in sorted(graph[name]):
                walk(other, [*way, name])
            done.add(name)

    for name in sorted(graph):
        walk(name, [])
    return found


def test_no_module_imports_itself_by_way_of_others() -> None:
    known = modules()
    graph = {name: imports_of(path, known) - {name} for name, path in known.items()}
    assert [" → ".join(circle) for circle in circles(graph)] == []


ROOMS = ("slam.formats", "slam.matching", "slam.odometry", "slam.mapping", "slam.graph")
ROOMS += ("stitch.alignment", "stitch.published", "stitch.mapping", "stitch.command")
ROOMS += ("scenarios.run_folder", "scenarios.report", "scenarios.evaluation", "scenarios.methods")
ROOMS += ("scenarios.ablate", "scenarios.bench", "scenarios.sweep", "scenarios.catalogue")
ROOMS += ("scenarios.score", "scenarios.suite", "scenarios.check", "scenarios.peers")


def room_of(name: str) -> str | None:
    return next((room for room in ROOMS if name == room or name.startswith(room + ".")), None)


def test_rooms_form_no_circle() -> None:
    known = modules()
    graph: dict[str, set[str]] = {room: set() for room in ROOMS}
    for name, path in known.items():
        room = room_of(name)
        if room is not None:
            graph[room] |= {r for r in map(room_of, imports_of(path, known)) if r not in (None, room)}  # type: ignore[misc]
    assert [" ⇄ ".join(circle) for circle in circles(graph)] == []


def test_a_circle_would_be_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == [["b", "c", "b"]]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []
