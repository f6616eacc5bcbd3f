"""Whatever cannot be used is told in one clear line, with exit code 2 and nothing written."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest

BEAMS = 180


def flaser(k: int, ranges: list[object] | None = None, stamp: float | None = None) -> str:
    """A line of a CARMEN log: the k-th scan of a drive straight on."""
    values = [2.0] * BEAMS if ranges is None else ranges
    pose = f"{0.1 * k} 0 0"
    time = float(k) if stamp is None else stamp
    return f"FLASER {len(values)} {' '.join(map(str, values))} {pose} {pose} {time} host {time}\n"


def odom(k: int) -> str:
    return f"ODOM {0.1 * k} 0 0 0.1 0 0 {k} host {k}\n"


LOG = "".join(flaser(k) for k in range(5))
SCANNER = "SEN {Time 1.0} {Type RangeScanner} {Name H} {Resolution 0.7854} {FOV 3.1416} {Range 1,2,3,4,5}\n"
INS = "SEN {Time 1.0} {Type INS} {Name I} {Location 1.0,2.0,0.0} {Orientation 0.0,0.0,0.5}\n"

BAD_LOGS = {
    "empty": (b"", "the file is empty"),
    "only blanks": (b" \n\n", "the file is empty"),
    "binary": (np.random.default_rng(0).bytes(4000), "not text, and of no kind that is known"),
    "some other text": (b"once upon a time\n", "not a recording: expected .*a USARSim log or a CARMEN log"),
    "a gzip torn off": (gzip.compress(LOG.encode())[:60], "torn gzip"),
    "a zip torn off": (b"PK\x03\x04 and no more", "expected a recording.npz"),
    "cut in the middle of a line": (LOG[:-700].encode(), r":5: .*cut in the middle\?"),
    "cut in its last stamp": (LOG[:-8].encode(), r":5: .*cut in the middle\?"),
    "USARSim cut in the middle of a line": ((INS + SCANNER)[:-9].encode(), r":2: .*cut in the middle\?"),
    "no range scans": ((odom(0) + odom(1)).encode(), "no range scans"),
    "USARSim without range scans": (INS.encode(), "no range scans"),
    "range that is no number": (
        (LOG + flaser(5, ["x"] * BEAMS)).encode(),
        ":6: .*'x', expected metres",
    ),
    "no beam that returns": (
        "".join(flaser(k, ["nan", -1.0] * 90) for k in range(5)).encode(),
        "no beam of 5 scans returned, expected ranges from 0.1 to 80 m",
    ),
    "a ROS 1 bag by another name": (b"#ROSBAG V2.0\n\0\0", "a ROS 1 bag"),
    "ranges of changing length": (
        (LOG + flaser(5, [2.0] * 181)).encode(),
        ":6: scan of 181 ranges, expected 180",
    ),
}

BAD_OPTIONS = {
    "field of view of a scenario": (["hospital", "--field-of-view", "180"], "--field-of-view is for logs"),
    "field of view of no laser": (
        ["good.log", "--field-of-view", "361"],
        "expected degrees up to 360, got 361",
    ),
    "nothing": ([], "expected a scenario or a log; scenarios: hospital"),
    "unknown scenario": (["hopsital"], r"unknown scenario 'hopsital': did you mean 'hospital'\?"),
    "nothing like a scenario": (["zzz"], "unknown scenario 'zzz': expected one of hospital"),
    "missing file": (["logs/Robot1.log"], "logs/Robot1.log: no such file"),
    "name too long": (["x" * 5000], "unknown scenario"),
    "directory": (["folder"], "folder: is a directory, expected a file"),
    "unknown method": (
        ["hospital", "--methods", "ins,slamstich"],
        r"'slamstich': did you mean 'slamstitch'\?",
    ),
    "no method": (["hospital", "--methods", ","], "--methods: expected one or more of ins, icp"),
    "unknown option": (["--sed", "3", "hospital"], r"unknown option '--sed': did you mean '--seed'\?"),
    "unknown option with a value": (
        ["hospital", "--ouput=x"],
        r"unknown option '--ouput': did you mean '--out'\?",
    ),
    "positional as option": (["--recording", "hospital"], "unknown option '--recording'"),
    "too much": (["hospital", "office"], "unexpected argument 'office'"),
    "option without value": (["hospital", "--seed"], "Missing value for argument '--seed'"),
    "seed that is no number": (["hospital", "--seed", "x"], "--seed: invalid literal .* 'x'"),
    "negative seed": (["hospital", "--seed", "-1"], "--seed: expected 0 or more, got -1"),
    "unknown format": (["hospital", "--format", "xml"], "'xml' .*Expected one of"),
    "mount of two numbers": (["good.log", "--laser-mount", "1", "2"], "--laser-mount.* Expected 3 values"),
    "mount that is no number": (["good.log", "--laser-mount", "1", "2", "x"], "--laser-mount: .* 'x'"),
    "mount that is NaN": (
        ["good.log", "--laser-mount", "nan", "0", "0"],
        "--laser-mount: expected three finite",
    ),
    "mount of a scenario": (["hospital", "--laser-mount", "0", "0", "0"], "--laser-mount are for logs"),
    "unknown dead reckoning": (["hospital", "--dead-reckoning", "gps"], "invalid choice 'gps'"),
    "relations of a scenario": (["hospital", "--relations", "good.relations"], "--relations .* for logs"),
    "relations missing": (["good.log", "--relations", "no.relations"], "no.relations: no such file"),
    "relations empty": (["good.log", "--relations", "empty"], "empty: the file is empty"),
    "relations that match nothing": (
        ["good.log", "--relations", "far.relations"],
        "far.relations: none of the 1",
    ),
    "relations that are none": (
        ["good.log", "--relations", "good.log"],
        r"good.log:1: relation of \d+ values",
    ),
    "other system's answer cut short": (
        ["peer.log"],
        r"peer.other_ref.txt: 1 poses, expected one for each of 5",
    ),
    "unknown corruption": (
        ["hospital", "--corrupt", "odometry.frozn=3"],
        r"--corrupt odometry.frozn=3: unknown .*: did you mean 'odometry.frozen'\?",
    ),
    "severity that is no number": (
        ["hospital", "--corrupt", "laser.noise=much"],
        "--corrupt laser.noise=much: expected a number after laser.noise=, got 'much'",
    ),
    "severity out of range": (
        ["hospital", "--corrupt", "laser.dropped=1.5"],
        r"--corrupt laser.dropped: expected a number from 0 to 1 \(share of the beams\), got 1.5",
    ),
    "half a freeze": (
        ["hospital", "--corrupt", "odometry.frozen=2.5"],
        "odometry.frozen: expected a whole number from 1 to 1000 .*, got 2.5",
    ),
    "severity of what has none": (["hospital", "--corrupt", "odometry.sign=2"], "expected no severity"),
    "freezes of a short log": (
        ["good.log", "--corrupt", "odometry.frozen"],
        "--corrupt odometry.frozen=3: expected more than 60 scans, got 5",
    ),
    "odometry of a log without": (
        ["good.log", "--corrupt", "odometry.missing", "--corrupt", "odometry.late"],
        "odometry.late=1: the recording has no dead reckoning",
    ),
    "out is a file": (["good.log", "--out", "good.log"], "--out good.log: good.log is not a folder"),
    "out is below a file": (
        ["hospital", "--out", "good.log/a/b"],
        "--out good.log/a/b: .*good.log is not a folder",
    ),
    "a file in the way": (["good.log", "--out", "taken"], "taken/good-seed0 is in the way"),
    "a folder that is no run in the way": (["good.log", "--out", "kept"], "kept/good-seed0 is in the way"),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with files good and bad."""
    monkeypatch.chdir(tmp_path)
    for name in ("folder", "taken", "kept/good-seed0"):
        Path(name).mkdir(parents=True)
    for name in ("good.log", "peer.log"):
        Path(name).write_text(LOG)
    for name in ("empty", "taken/good-seed0", "kept/good-seed0/thesis.txt"):
        Path(name).touch()
    Path("good.relations").write_text("0 1 0.1 0 0 0 0 0\n")
    Path("far.relations").write_text("1000 1001 0.1 0 0 0 0 0\n")
    Path("peer.other_ref.txt").write_text("0 0 0 0\n")
    return tmp_path


def everything_in(folder: Path) -> dict[Path, tuple[int, int]]:
    """Every path with its size and when it was changed: also a file made and removed again leaves a trace."""
    return {p: (p.lstat().st_size, p.lstat().st_mtime_ns) for p in [folder, *folder.rglob("*")]}


def is_refused(command, words, expected, folder):
    before = everything_in(folder)
    finished = command(*words)
    assert re.search(expected, finished.stderr)
    assert re.fullmatch(r"scenarios\.run: [^\n]+\n", finished.stderr)
    assert len(finished.stderr) < 6000
    assert finished.stdout == ""
    assert finished.code == 2
    assert everything_in(folder) == before


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_bad_options_are_refused(case, command, here):
    is_refused(command, *BAD_OPTIONS[case], here)


@pytest.mark.parametrize("case", BAD_LOGS)
def test_bad_logs_are_refused(case, command, here):
    content, expected = BAD_LOGS[case]
    Path("bad.log").write_bytes(content)
    is_refused(command, ["bad.log", "--out", "new/runs"], "bad.log" + ".*" + expected, here)


@pytest.mark.usefixtures("no_figures")
def test_the_good_log_is_good(command, here):
    """Or the refusals above would say nothing."""
    finished = command("good.log", "--methods", "ins", "--relations", "good.relations", "--out", "new/runs")
    assert finished.code == 0
    assert (here / "new/runs/good-seed0/metrics.json").is_file()
    assert " relation_trans_mean " in finished.stdout


@pytest.mark.usefixtures("no_figures")
def test_time_stamps_may_go_backwards(command, here):
    stamps = [1.0, 2.0, 1.5, 1.2, 3.0]
    Path("back.log").write_text("".join(flaser(k, stamp=stamp) for k, stamp in enumerate(stamps)))
    assert command("back.log", "--methods", "ins").code == 0
    tum = np.loadtxt(here / "runs/latest/trajectories/ins.tum")
    assert tum[:, 0].tolist() == stamps


def test_a_folder_that_cannot_be_made_is_told_in_one_line(command, here, monkeypatch):
    """Root may write everywhere, but not make a folder in /proc."""
    if not Path("/proc/self").exists():
        pytest.skip("no /proc here")
    finished = command("good.log", "--methods", "ins", "--out", "/proc/runs")
    assert finished.code == 2
    assert re.fullmatch(
        r"scenarios\.run: --out /proc/runs: .*cannot be written.*", finished.stderr.splitlines()[-1]
    )


def test_a_full_disk_is_told_in_one_line(command, here, monkeypatch):
    import errno

    from scenarios.run_folder import write

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(write, "write_run", full)
    finished = command("good.log", "--methods", "ins", "--out", "new/runs")
    assert finished.code == 2
    assert finished.stderr.splitlines()[-1] == (
        "scenarios.run: --out new/runs: cannot be written: No space left on device"
    )
    assert not (here / "new").exists()
