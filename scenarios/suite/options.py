"""What can be asked of the suite, and the options of each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

Part = Literal["test", "train", "all"]


@dataclass(frozen=True)
class ExportOptions:
    """Write the suite's recordings for other systems to run on, and their truth into a second folder.

    DIR has a folder for each recording: a ROS 2 bag, a CARMEN and a USARSim log, an npz and a card; DIR-truth
    has the truth as TUM files and as CARMEN's relations.
    """

    folder: Positional[Annotated[Path, arg(metavar="DIR", help_behavior_hint="")]]
    """A new folder."""
    without_truth: Annotated[bool, arg(help_behavior_hint="")] = False
    """Leave out the truth of the test recordings, to hand the suite to those who shall be tested."""
    split: Part = "all"
    """Which of the recordings."""
    scenarios: Annotated[str, arg(metavar="A,B,…", help_behavior_hint="")] = ""
    """Only these scenarios."""
    formats: Annotated[str, arg(metavar="A,B,…")] = "rosbag,carmen,usarsim,npz"
    """What each recording is written as; the npz always."""


@dataclass(frozen=True)
class AnswerOptions:
    """Run a method on the suite's recordings as a stranger would, and write what `score` takes."""

    folder: Positional[Annotated[Path, arg(metavar="DIR", help_behavior_hint="")]]
    """The suite, as exported."""
    method: Positional[Annotated[str, arg(metavar="METHOD", help_behavior_hint="")]]
    """A method of ours, or MODULE:METHOD."""
    out: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")]
    """A new folder for a TUM file each, and answers.json with the cost."""
    split: Part = "test"
    """Which of the recordings."""
    scenarios: Annotated[str, arg(metavar="A,B,…", help_behavior_hint="")] = ""
    """Only these scenarios."""


@dataclass(frozen=True)
class ScoreOptions:
    """Score a submission: a folder or a zip of TUM files named like the recordings, as hospital-0.tum.

    Beside them answers.json may state what they cost, {"wall_s": {"hospital-0": 12.3}, "machine": "…"}, and
    why a recording was refused, {"refused": {"corridor-1": "…"}}. A recording without an answer counts as
    failed, as does one with poses for less than 90 % of its scans.
    """

    folder: Positional[Annotated[Path, arg(metavar="DIR", help_behavior_hint="")]]
    """The suite, as exported, its truth beside it in DIR-truth."""
    answers: Positional[Annotated[Path, arg(metavar="ANSWERS.zip|FOLDER", help_behavior_hint="")]]
    """The submission."""
    name: str = ""
    """What it is called; without, as its file is."""
    split: Part = "test"
    """Which of the recordings; only rows of test are compared with others' on a page."""
    scenarios: Annotated[str, arg(metavar="A,B,…", help_behavior_hint="")] = ""
    """Only these scenarios."""
    truth: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    """Where the truth is, if not in DIR-truth."""
    poses_of: Literal["robot", "laser"] = "robot"
    """Whose poses they are, where a file does not say."""
    tolerance: Annotated[float, arg(metavar="S")] = 0.02
    """How far a pose's stamp may be from its scan's [s]."""
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="ROW.json", help_behavior_hint="")] = None
    """File for the row, which `page` takes."""
    format: Literal["table", "json"] = "table"
    """What is printed on stdout."""


@dataclass(frozen=True)
class PageOptions:
    """All submissions side by side: means, worst cases, failures, paired tests, and stated costs."""

    rows: Positional[Annotated[tuple[Path, ...], arg(metavar="ROW.json …", help_behavior_hint="")]]
    """Rows that `score` wrote."""
    out: Annotated[Path, arg(aliases=["-o"], metavar="FILE")] = Path("suite.html")
    """The page."""
    format: Literal["table", "markdown", "latex"] = "table"
    """How the table is printed."""


PARTS = {"export": ExportOptions, "answer": AnswerOptions, "score": ScoreOptions, "page": PageOptions}
"""What can be asked → its options; the module of that name here has ``run(options)``."""
