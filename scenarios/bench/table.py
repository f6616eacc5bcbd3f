"""Figures as a table for the console and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from scenarios.bench.figure import Figure

Machine = Mapping[str, object]


def machine_line(machine: Machine) -> str:
    """What the figures were measured on, in one line."""
    packages = machine["packages"]
    assert isinstance(packages, Mapping)
    versions = ", ".join(f"{name} {packages[name]}" for name in ("numpy", "numba", "pymunk"))
    return f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, {versions}"


def number(value: float) -> str:
    """A number with three digits, none of them behind the point once it has that many before it."""
    if value == 0.0:
        return "0"
    return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"


def print_figures(title: str, figures: Sequence[Figure], machine: Machine) -> None:
    """Median and range of every figure, then the machine, on stdout."""
    import rich.box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, box=rich.box.SIMPLE_HEAD)
    table.add_column("figure", no_wrap=True)
    for column in ("median", "min–max"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("n", justify="right", no_wrap=True)
    table.add_column("note", no_wrap=True)
    for f in figures:
        spread = f"{number(min(f.values))}–{number(max(f.values))}" if len(f.values) > 1 else ""
        table.add_row(f.name, number(f.median), spread, f.unit, str(len(f.values)), f.note)
    console = Console(width=max(160, Console().width), highlight=False)
    console.print(table)
    console.print(machine_line(machine), soft_wrap=True)


def figures_json(benches: Mapping[str, Sequence[Figure]], machine: Machine) -> str:
    """Every bench's figures with all their repetitions, and the machine."""
    found = {
        name: [asdict(f) | {"median": f.median, "min": min(f.values), "max": max(f.values)} for f in figures]
        for name, figures in benches.items()
    }
    return json.dumps({"schema": 1, "environment": dict(machine), "benches": found}, indent=2)
