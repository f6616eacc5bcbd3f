"""What was measured as tables for the console and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from scenarios.bench.figure import Figure
from scenarios.bench.measured import Measured, Table

if TYPE_CHECKING:
    import rich.table

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


def print_measured(name: str, measured: Measured, machine: Machine) -> None:
    """Tables, then median and range of every figure, notes, and the machine, on stdout."""
    from rich.console import Console

    console = Console(width=max(160, Console().width), highlight=False)
    for table in measured.tables:
        console.print(_drawn(table))
    if measured.figures:
        console.print(_figures(name, measured.figures))
    for note in measured.notes:
        console.print(note, soft_wrap=True, markup=False)
    console.print(machine_line(machine), soft_wrap=True)


def _drawn(table: Table) -> rich.table.Table:
    import rich.box
    import rich.markup
    import rich.table

    drawn = rich.table.Table(title=table.title, title_justify="left", box=rich.box.SIMPLE_HEAD)
    for i, column in enumerate(table.columns):
        drawn.add_column(column, justify="left" if i < table.names else "right", no_wrap=True)
    for i, row in enumerate(table.rows):
        drawn.add_row(*map(rich.markup.escape, row), end_section=i in table.sections)
    return drawn


def _figures(title: str, figures: Sequence[Figure]) -> rich.table.Table:
    import rich.box
    import rich.table

    table = rich.table.Table(title=title, box=rich.box.SIMPLE_HEAD)
    table.add_column("figure", no_wrap=True)
    for column in ("median", "min–max"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("n", justify="right", no_wrap=True)
    table.add_column("note", no_wrap=True)
    for f in figures:
        spread = f"{number(min(f.values))}–{number(max(f.values))}" if len(f.values) > 1 else ""
        table.add_row(f.name, number(f.median), spread, f.unit, str(len(f.values)), f.note)
    return table


def measured_json(benches: Mapping[str, Measured], machine: Machine) -> str:
    """Every bench's figures with all their repetitions, its records and notes, and the machine."""
    found = {
        name: [
            asdict(f) | {"median": f.median, "min": min(f.values), "max": max(f.values)} for f in m.figures
        ]
        for name, m in benches.items()
    }
    return json.dumps(
        {
            "schema": 1,
            "environment": dict(machine),
            "benches": found,
            "records": {name: dict(m.records) for name, m in benches.items() if m.records},
            "notes": {name: list(m.notes) for name, m in benches.items() if m.notes},
        },
        indent=2,
    )
