"""What each corruption of a recording does to the answers of the methods: ratios to the clean drives."""

from __future__ import annotations

import shlex
import sys
from functools import partial
from pathlib import Path

from scenarios.ablate.options import RobustnessOptions
from scenarios.ablate.robustness.findings import DriveResult, analyse, verdict
from scenarios.ablate.robustness.page import (
    clean_table,
    ratio_table,
    render,
    result_columns,
    result_rows,
    save_picture,
)
from scenarios.ablate.robustness.trials import Log, load_drive, run_trial, spoilings, trials
from scenarios.catalogue import CATALOGUE
from scenarios.jsonable import document
from scenarios.methods import METHODS
from scenarios.options import parse_names, parse_seeds
from scenarios.sweep import check, finish, write_results
from sim.corruption import CORRUPTIONS, LEVELS
from slam.cli import InputError
from slam.formats.text import recording_name


def run(options: RobustnessOptions) -> None:
    """Every method on every spoilt drive, the tables, and the page. Exits with 1 when a trial failed."""
    methods = parse_names(options.methods, METHODS, "method")
    kinds = parse_names(options.kinds or ",".join(CORRUPTIONS), CORRUPTIONS, "kind")
    levels = parse_names(options.severities, LEVELS, "severity", "--severities")
    scenarios, seeds, logs = checked(options)
    asked = trials(scenarios, logs, seeds, spoilings(kinds, levels), methods)
    swept = options.sweep(asked, run_trial, prepare=partial(load_drive, logs=logs))
    results = [DriveResult.of(*both) for both in zip(swept.trials, swept.answers, strict=True)]
    findings = analyse(results, logs)
    sentences = verdict(findings)
    write_results(options.out / "results.csv", result_columns(findings), result_rows(findings))
    picture = save_picture(findings, options.out / "ratios.png")
    command = shlex.join(["python", "-m", "scenarios.ablate", "robustness", *sys.argv[1:]])
    page = options.out / "index.html"
    page.write_text(render(findings, sentences, picture, command=command), encoding="utf-8")
    if options.format == "json":
        rows = [one for row in findings.rows for one in row]
        about = {"study": "robustness", "recordings": [*scenarios, *logs], "seeds": seeds}
        print(document(**about, verdict=sentences, clean=findings.clean, ratios=rows))
    else:
        clean_table(findings).print()
        ratio_table(findings, f"robustness: seeds {options.seeds}").print()
        print("\n".join(["", *sentences, "", str(page)]))
    finish(swept, options.store)


def checked(options: RobustnessOptions) -> tuple[list[str], list[int], dict[str, Log]]:
    """Scenarios, seeds, and logs by the names that tables have for them. Raises `InputError`."""
    logs = read_logs(options.logs, options.relations)
    scenarios = []
    if options.scenarios.strip() or not logs:
        scenarios = parse_names(options.scenarios, CATALOGUE, "scenario")
    check(options.scheduler, options.workers, options.out)
    return scenarios, parse_seeds(options.seeds), logs


def read_logs(paths: str, relations: str) -> dict[str, Log]:
    """Logs by name, each with its relations: as many with commas between, in the order of the logs, and
    nothing between two commas for a log without. Raises `InputError`."""
    files = [word.strip() for word in paths.split(",") if word.strip()]
    beside = [word.strip() for word in relations.split(",")] if relations.strip() else [""] * len(files)
    if len(beside) != len(files):
        raise InputError(f"--relations: expected one for each of {len(files)} --logs, got {len(beside)}")
    logs = {}
    for file, known in zip(files, beside, strict=True):
        name = recording_name(Path(file)).removesuffix(".raw")
        if name in logs or name in CATALOGUE:
            raise InputError(f"--logs {file}: {name!r} is already the name of another recording")
        if not Path(file).exists():
            raise InputError(f"--logs {file}: no such file")
        logs[name] = Log.checked(Path(file).resolve(), Path(known).resolve() if known else None)
    return logs
