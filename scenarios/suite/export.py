"""The suite's recordings for other systems to run on, their truth in a second folder."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from scenarios import source
from scenarios.options import parse_names
from scenarios.suite.folder import (
    SUFFIXES,
    truth_folder,
    write_entry,
    write_suite,
    write_truth,
)
from scenarios.suite.options import ExportOptions
from scenarios.suite.version import Entry, chosen
from slam.cli import InputError


def run(options: ExportOptions) -> None:
    """Simulate every recording, write it, and print the folders. Nothing is left of an export that fails.
    Raises `InputError`."""
    entries = chosen(options.split, options.scenarios)
    formats = parse_names(options.formats, SUFFIXES, "format")
    final, truth = options.folder, truth_folder(options.folder.absolute())
    for folder in (final, truth):
        if folder.exists():
            raise InputError(f"{folder}: exists already, expected a new folder")
    if not final.absolute().parent.is_dir():
        raise InputError(f"{final.absolute().parent}: no such folder")
    try:
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=final.absolute().parent) as temporary:
            made, told = Path(temporary) / "suite", Path(temporary) / "truth"
            made.mkdir()
            told.mkdir()
            write_all(made, told, entries, formats, withheld=options.without_truth)
            if any(told.iterdir()):
                told.rename(truth)
            made.rename(final)
    except (OSError, ValueError) as error:
        shutil.rmtree(truth, ignore_errors=True)
        raise InputError(f"{final}: {error}") from error
    print(final)
    if truth.exists():
        print(truth)


def write_all(folder: Path, truth: Path, entries: list[Entry], formats: list[str], withheld: bool) -> None:
    """Write every recording, and its truth into ``truth`` unless that of the test is ``withheld``."""
    known, others = {}, []
    for number, entry in enumerate(entries, start=1):
        print(f"{number}/{len(entries)} {entry.name}", file=sys.stderr)
        recording = source.simulated(entry.scenario, entry.seed).recording
        known[entry.name] = write_entry(folder, entry, recording, formats)
        known[entry.name]["truth"] = write_truth(truth, entry.name, recording)
        if withheld and entry.split == "test":  # its hash is kept: nobody can change it later
            for file in truth.glob(f"{entry.name}.*"):
                file.unlink()
        others += [] if known[entry.name]["frozen"] else [entry.name]
    write_suite(folder, known)
    if others:
        why = "another processor, or other versions of what simulates"
        text = (
            f"{len(others)} of {len(entries)} recordings are not those of the suite as it was frozen ({why})"
        )
        print(f"{text}: compare only rows scored on this export: {', '.join(others)}", file=sys.stderr)
