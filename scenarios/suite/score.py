"""A submission scored against the truth: one row."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.evaluation import evaluate
from scenarios.score.answers import LONGEST_NAME, to_estimate
from scenarios.stages import environment
from scenarios.suite.folder import read_recording, read_suite, read_truth, truth_folder
from scenarios.suite.options import ScoreOptions
from scenarios.suite.row import FAILED, SCORED, UNANSWERED, Result, Row
from scenarios.suite.submission import Submission, read_submission
from scenarios.suite.table import table
from scenarios.suite.version import chosen
from slam.cli import InputError
from stitch.mapping.estimate import NoEstimate

if TYPE_CHECKING:
    from slam.recording import Recording
    from slam.trajectory import Body


def run(options: ScoreOptions) -> None:
    """The submission's row, printed and kept. Raises `InputError`, and writes nothing then."""
    if not 0.0 <= options.tolerance <= 1.0:
        raise InputError(f"--tolerance: expected 0 to 1 s, got {options.tolerance:g}")
    if options.out is not None and not options.out.absolute().parent.is_dir():
        raise InputError(f"--out {options.out}: {options.out.parent} is no folder")
    known = read_suite(options.folder)
    truth = options.truth or truth_folder(options.folder.absolute())
    submission = read_submission(options.answers, list(known))
    names = [entry.name for entry in chosen(options.split, options.scenarios) if entry.name in known]
    if not names:
        raise InputError(f"{options.folder}: has none of the recordings asked for")
    results = {}
    for name in names:
        entry = known[name]
        recording = read_recording(options.folder, name, entry["npz"])
        poses = read_truth(truth, name, recording, entry["truth"])
        result = judge(replace(recording, truth=poses), name, submission, options.tolerance, options.poses_of)
        results[name] = replace(result, fingerprint=entry["fingerprint"], frozen=entry["frozen"])
    code = str(environment()["git"] or environment()["slamstitch"])
    title = options.name or options.answers.absolute().name.removesuffix(".zip")
    row = Row(_printable(title), options.split, results, submission.machine, code, options.tolerance)
    if options.out is not None:
        try:
            Path(options.out).write_text(row.to_json(), encoding="utf-8")
        except OSError as error:
            raise InputError(f"--out {options.out}: cannot be written: {error.strerror}") from error
    print(row.to_json() if options.format == "json" else table([row]).console(), end="\n")


def judge(recording: Recording, name: str, submission: Submission, tolerance: float, body: Body) -> Result:
    """What became of a recording with truth. Raises `InputError` where no stamp of its answer matches."""
    wall_s = submission.wall_s.get(name)
    if name not in submission.trajectories:
        reason = submission.refused.get(name, "")
        return Result(FAILED if reason else UNANSWERED, reason, {}, wall_s, "", False)
    found, _ = to_estimate(name, submission.trajectories[name], recording, tolerance, body)
    if isinstance(found, NoEstimate):
        return Result(FAILED, found.reason, {}, wall_s, "", False)
    metrics = {m.name: m.value for m in evaluate(recording, [found]) if m.value is not None}
    return Result(SCORED, "", metrics, wall_s, "", False)


def _printable(name: str) -> str:
    """The name of a submission in one line, with nothing that a terminal would obey."""
    return re.sub(r"[^\x20-\x7e\u00a0-\ufffd]+", "_", name).strip()[:LONGEST_NAME] or "unnamed"
