"""A method run on the suite's recordings as a stranger runs it: blind, and with the same files to hand in."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from scenarios.check.__main__ import find_method
from scenarios.jsonable import dump
from scenarios.methods.config import MethodConfig
from scenarios.methods.warm_up import warm_up_recording
from scenarios.stages import environment
from scenarios.suite.folder import read_recording, read_suite
from scenarios.suite.options import AnswerOptions
from scenarios.suite.submission import NOTES
from scenarios.suite.version import chosen
from slam.cli import InputError
from slam.formats import tum
from stitch.mapping.estimate import NoEstimate


def run(options: AnswerOptions) -> None:
    """A TUM file for every recording that the method answers, and what it cost. Raises `InputError`."""
    method, known = find_method(options.method), read_suite(options.folder)
    if method.sees_truth:
        raise InputError(f"{method.name} is told the truth, which the suite's recordings have not")
    if options.out.exists():
        raise InputError(f"{options.out}: exists already, expected a new folder")
    entries = [entry for entry in chosen(options.split, options.scenarios) if entry.name in known]
    if not entries:
        raise InputError(f"{options.folder}: has none of the recordings asked for")
    cost, refused = {}, {}
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=options.out.absolute().parent) as temporary:
        made = Path(temporary) / "answers"
        made.mkdir()
        for number, entry in enumerate(entries, start=1):
            recording = read_recording(options.folder, entry.name, known[entry.name]["npz"])
            if number == 1:
                method(warm_up_recording(recording), MethodConfig())  # compiles what it compiles
            started = time.perf_counter()
            found = method(recording, MethodConfig())
            cost[entry.name] = round(time.perf_counter() - started, 3)
            print(f"{number}/{len(entries)} {entry.name} {cost[entry.name]:.1f} s", file=sys.stderr)
            if isinstance(found, NoEstimate):
                refused[entry.name] = found.reason
            else:
                tum.write(made / f"{entry.name}.tum", recording.time, found.poses, found.covariance)
        machine = f"{environment()['processor']}, {environment()['cores']} cores"
        dump(made / NOTES, {"wall_s": cost, "refused": refused, "machine": machine})
        made.rename(options.out)
    print(options.out)
