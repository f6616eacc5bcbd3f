"""Damaged files of every format: each is read, or refused in one line, in bounded time and memory."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections import Counter
from pathlib import Path

from scenarios.bench.fuzzing import worker
from scenarios.bench.fuzzing.mutations import MUTATIONS
from scenarios.bench.fuzzing.samples import samples
from scenarios.bench.result import BenchmarkOptions, BenchmarkResult
from scenarios.stages import Stages
from slam.table import Table

KEPT = Path("runs") / "fuzz"
"""Where files that failed are kept."""
MOST_KEPT = 20


def run(stages: Stages, options: BenchmarkOptions) -> BenchmarkResult:
    """Damage ``options.files`` files, and count what reading them does, by format and by damage."""
    results: list[worker.Outcome] = []
    with stages.stage("fuzz"):
        for outcome in worker.outcomes(options.seed, options.files, len(os.sched_getaffinity(0))):
            results.append(outcome)
            if outcome.failed:
                words = f"file {outcome.index}, {outcome.kind}, {outcome.mutation}: {outcome.outcome}"
                stages.console.print(
                    f"{words} {outcome.detail}", highlight=False, markup=False, soft_wrap=True
                )
            if len(results) % 5000 == 0:
                stages.console.print(f"{len(results)} files", style="dim", highlight=False)
    failures = sorted((result for result in results if result.failed), key=lambda result: result.index)
    notes = [f"{result.outcome}: {path}: {result.detail}" for result, path in _kept(failures, options.seed)]
    if len(failures) > MOST_KEPT:
        notes.append(f"and {len(failures) - MOST_KEPT} more, see the table")
    bounds = f"in {worker.SECONDS:g} s and {worker.BYTES / 1e9:g} GB"
    notes.append(f"{len(failures)} of {len(results)} files neither read nor refused in one line {bounds}")
    return BenchmarkResult(tables=[_table(results)], notes=notes, failures=len(failures))


def _table(results: list[worker.Outcome]) -> Table:
    """Formats × mutations: how many were read, were refused, and failed."""
    cells = Counter((result.kind, result.mutation, result.outcome) for result in results)
    kinds = dict.fromkeys(result.kind for result in sorted(results, key=lambda result: result.index))
    rows = []
    for kind in kinds:
        row = [kind]
        for mutation in MUTATIONS:
            read, refused = (cells[kind, mutation, outcome] for outcome in (worker.READ, worker.REFUSED))
            failed = sum(cells[kind, mutation, outcome] for outcome in worker.OUTCOMES[2:])
            row.append(f"{read} / {refused} / {failed}")
        rows.append(tuple(row))
    return Table(("read / refused / failed", *MUTATIONS), rows, "damaged files")


def _kept(failures: list[worker.Outcome], seed: int) -> list[tuple[worker.Outcome, Path]]:
    """The first failures, and the folder in which the files of each are kept."""
    if not failures:
        return []
    kept = []
    with tempfile.TemporaryDirectory() as folder:
        made = samples(Path(folder))
        for failure in failures[:MOST_KEPT]:
            path = KEPT / f"{seed}-{failure.index}"
            shutil.rmtree(path, ignore_errors=True)
            worker.write(path, worker.damaged(made, seed, failure.index)[2])
            kept.append((failure, path / made[failure.kind].entry))
    return kept
