"""A suite is exported, answered, scored and compared; on made recordings under the suite's names."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.catalogue import CATALOGUE
from scenarios.score.truth import entry_file, truth_beside
from scenarios.source import Source
from scenarios.stages import environment
from scenarios.suite import __main__ as command
from scenarios.suite.row import read_row
from scenarios.suite.significance import compare, friedman, mean_ranks
from scenarios.suite.version import fingerprint, suite
from sim.record import simulate
from slam.formats import FORMATS, load, tum
from slam.recording import Recording
from slam.se2 import Array

Suite = Callable[..., int]


@pytest.fixture(scope="session")
def drives(
    record: Callable[..., Recording], room: Array, curve: Callable[..., Array]
) -> dict[str, Recording]:
    """What stands for the drives of two scenarios."""
    made = {}
    for k, name in enumerate(["hospital-0", "hospital-1", "hospital-2", "hospital-100", "hospital-101"]):
        truth = curve(25 + k)
        reckoned = truth * [1.05, 1.0, 1.0 + 0.01 * k]
        made[name] = record(room, truth, dead_reckoning=reckoned, seed=k)
    return made


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, drives: dict[str, Recording], tmp_path: Path) -> Suite:
    """``python -m scenarios.suite WORDS`` in a folder of its own, where simulating takes no time."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("scenarios.source.simulated", lambda name, seed: Source(drives[f"{name}-{seed}"], {}))
    return lambda *words: command.run([str(word) for word in words])


@pytest.fixture
def exported(run: Suite) -> Path:
    assert run("export", "v1", "--scenarios", "hospital", "--formats", "npz") == 0
    return Path("v1")


@pytest.fixture
def answers(exported: Path, drives: dict[str, Recording]) -> Path:
    """True poses, half a metre off, for the three recordings of the test."""
    folder = Path("answers")
    folder.mkdir()
    for name in ("hospital-0", "hospital-1", "hospital-2"):
        drive = drives[name]
        assert drive.truth is not None
        tum.write(folder / f"{name}.tum", drive.time, np.add(drive.truth, [0.5, 0.0, 0.0]))
    return folder


def test_every_format_of_a_recording_is_blind_and_the_truth_is_apart(
    run: Suite, drives: dict[str, Recording]
) -> None:
    pytest.importorskip("rosbags", reason="ROS 2 bags need rosbags: pip install 'slamstitch[ros]'")
    assert run("export", "v1", "--scenarios", "hospital", "--split", "test") == 0
    for suffix in (".bag2", ".log", ".usarsim.log", ".npz"):
        found = load(Path("v1/hospital-1") / f"hospital-1{suffix}")
        assert found.truth is None
        assert len(found) == 26
    stated = json.loads(Path("v1/suite.json").read_text())["entries"]
    assert list(stated) == ["hospital-0", "hospital-1", "hospital-2"]
    card = Path("v1/hospital-0/card.md").read_text()
    for words in ("25 scans", "181 beams", "traps", "licence", "second folder", "never tune on it"):
        assert words in card
    time, poses = tum.read("v1-truth/hospital-1.tum")
    np.testing.assert_array_equal(time, drives["hospital-1"].time)
    np.testing.assert_allclose(poses, drives["hospital-1"].truth, atol=1e-15)  # type: ignore[arg-type]
    assert Path("v1-truth/hospital-1.relations").is_file()
    assert entry_file("v1/hospital-1") == "v1/hospital-1/hospital-1.npz"
    assert truth_beside("v1/hospital-1/hospital-1.log") == Path.cwd() / "v1-truth/hospital-1.tum"


def test_the_truth_of_the_test_can_be_withheld(run: Suite, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", "v1", "--scenarios", "hospital", "--formats", "npz", "--without-truth") == 0
    assert {file.stem for file in Path("v1-truth").iterdir()} == {"hospital-100", "hospital-101"}
    assert run("answer", "v1", "ins", "-o", "a") == 0
    capsys.readouterr()
    assert run("score", "v1", "a") == 2
    assert "expected the truth of hospital-0: was it withheld?" in capsys.readouterr().err


def test_a_zip_is_scored_and_what_is_missing_has_failed(
    run: Suite, answers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (answers / "hospital-2.tum").unlink()
    lines = (answers / "hospital-1.tum").read_text().splitlines(keepends=True)
    (answers / "hospital-1.tum").write_text("".join(lines[:15]))
    (answers / "answers.json").write_text(
        json.dumps({"wall_s": {"hospital-0": 2.5}, "refused": {"hospital-2": "too dark"}, "machine": "mine"})
    )
    (answers / "evil.py").write_text("raise SystemExit(99)")
    with zipfile.ZipFile("theirs.zip", "w") as archive:
        for file in answers.iterdir():
            archive.write(file, f"some/folder/{file.name}")
    assert run("score", "v1", "theirs.zip", "-o", "row.json") == 0
    assert "theirs" in capsys.readouterr().out
    row = read_row(Path("row.json"))
    assert (row.name, row.machine, row.failures) == ("theirs", "mine", 2)
    assert {name: (r.status, r.reason) for name, r in row.results.items()} == {
        "hospital-0": ("scored", ""),
        "hospital-1": ("failed", "poses for 53.8 % of the scans, expected at least 90 %"),
        "hospital-2": ("failed", "too dark"),
    }
    assert row.results["hospital-0"].metrics["ate_rmse"] == pytest.approx(0.0, abs=1e-9)
    assert row.results["hospital-0"].wall_s == 2.5
    assert row.wall_s is None  # not stated for all
    assert row.errors(["hospital-0", "hospital-2"])[1] == np.inf


def test_our_methods_answer_as_strangers_do_and_the_page_compares_all(
    run: Suite, answers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("answer", "v1", "ins", "-o", "ours") == 0
    assert run("score", "v1", "ours", "-o", "ours.json") == 0
    (answers / "hospital-2.tum").unlink()
    assert run("score", "v1", answers, "--name", "<script>alert(1)</script>", "-o", "theirs.json") == 0
    capsys.readouterr()
    assert run("page", "ours.json", "theirs.json", "-o", "page.html") == 0
    told = capsys.readouterr().out
    assert "2/3" in told
    text = Path("page.html").read_text()
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text
    assert "not answered" in text
    assert "3 recordings are too few" in text
    assert "not all recordings are those" in text.lower()
    assert float(json.loads(Path("ours/answers.json").read_text())["wall_s"]["hospital-0"]) >= 0.0


def pathless(path: str, data: bytes = b"1 0 0 0 0 0 0 1\n") -> Callable[[], None]:
    def write() -> None:
        with zipfile.ZipFile("bad.zip", "w") as archive:
            archive.writestr(path, data)

    return write


def huge() -> None:
    with zipfile.ZipFile("bad.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("hospital-0.tum", bytes(40_000))


def link() -> None:
    entry = zipfile.ZipInfo("hospital-0.tum")
    entry.external_attr = 0o120777 << 16
    with zipfile.ZipFile("bad.zip", "w") as archive:
        archive.writestr(entry, "/etc/passwd")


def twice() -> None:
    with zipfile.ZipFile("bad.zip", "w") as archive:
        for folder in "ab":
            archive.writestr(f"{folder}/hospital-0.tum", "1 0 0 0 0 0 0 1\n")


def torn() -> None:
    pathless("hospital-0.tum", b"1 0 0 0 0 0 0 1\n" * 1000)()
    data = bytearray(Path("bad.zip").read_bytes())
    data[60:70] = b"xxxxxxxxxx"
    Path("bad.zip").write_bytes(data)


BAD: dict[str, tuple[Callable[[], object], str]] = {
    "climbs": (pathless("../hospital-0.tum"), "'../hospital-0.tum' leaves the folder"),
    "climbs the other way": (pathless("a\\..\\..\\hospital-0.tum"), "leaves the folder"),
    "absolute": (pathless("/tmp/hospital-0.tum"), "leaves the folder"),
    "link": (link, "is a link, expected files"),
    "huge": (huge, "a file of 40,000 bytes, expected at most 30,000"),
    "twice": (twice, "two answers for hospital-0"),
    "torn": (torn, "bad.zip: cannot be read: Bad CRC-32"),
    "foreign": (pathless("hopsital-0.tum"), "no recording of the suite: did you mean 'hospital-0'?"),
    "nan": (pathless("hospital-0.tum", b"1 nan 0 0 0 0 0 1"), "expected a finite number"),
    "other stamps": (pathless("hospital-0.tum", b"1e9 0 0 0 0 0 0 1"), "none of its 1 stamps"),
    "pickle": (pathless("hospital-0.npz", b"\x80\x04\x95K\x05."), "hospital-0.npz"),
    "empty": (pathless("readme.md"), "no answers, expected files as hospital-0.tum"),
    "cost": (pathless("answers.json", b'{"wall_s": {"hospital-0": "x"}}'), "answers.json: could not convert"),
    "cost of others": (pathless("answers.json", b'{"wall_s": {"x": 1}}'), "'x' is no recording of the suite"),
    "no zip": (lambda: Path("bad.zip").write_text("hello"), "expected a folder or a zip"),
    "nothing": (lambda: None, "no such file or folder"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_submission_is_told_in_one_line_and_nothing_is_written(
    name: str,
    run: Suite,
    exported: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    make, message = BAD[name]
    make()
    monkeypatch.setattr("slam.formats.answer.MAX_BYTES", 30_000)
    before = sorted(Path().rglob("*"))
    capsys.readouterr()
    assert run("score", "v1", "bad.zip", "-o", "row.json") == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1
    assert sorted(Path().rglob("*")) == before


def test_a_recording_or_a_truth_that_was_changed_is_refused(
    run: Suite, answers: Path, drives: dict[str, Recording], capsys: pytest.CaptureFixture[str]
) -> None:
    truth = Path("v1-truth/hospital-0.tum")
    kept = truth.read_bytes()
    truth.write_bytes(kept.replace(b"0.0", b"0.1", 1))
    assert run("score", "v1", answers) == 2
    assert "changed since the suite was exported" in capsys.readouterr().err
    truth.write_bytes(kept)
    write = FORMATS["npz"].write
    assert write is not None
    write("v1/hospital-0/hospital-0.npz", drives["hospital-1"])
    assert run("score", "v1", answers) == 2
    assert "hospital-0.npz: changed since" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["exprt"], "unknown name 'exprt': did you mean 'export'?"),
        (["export", "v1"], "v1: exists already"),
        (["export", "no/v2"], "no such folder"),
        (
            ["export", "v2", "--scenarios", "hopsital"],
            "unknown scenario 'hopsital': did you mean 'hospital'?",
        ),
        (["export", "v2", "--formats", "bag"], "unknown format 'bag'"),
        (["score", "answers", "answers"], "answers: no suite, expected suite.json"),
        (["score", "v1", "answers", "-o", "no/row.json"], "is no folder"),
        (["score", "v1", "answers", "--tolerance", "2"], "--tolerance: expected 0 to 1 s"),
        (["answer", "v1", "oracle", "-o", "b"], "oracle is told the truth"),
        (["answer", "v1", "ins", "-o", "answers"], "answers: exists already"),
        (["page"], "expected one or more rows"),
        (["page", "v1/suite.json"], "expected a row that score wrote"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], message: str, run: Suite, answers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert run(*words) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1


def test_rows_that_cannot_be_compared_are_refused(
    run: Suite, answers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("score", "v1", answers, "-o", "a.json") == 0
    whole = json.loads(Path("a.json").read_text())

    def refused(change: Callable[[dict], object], message: str) -> None:  # type: ignore[type-arg]
        other = json.loads(json.dumps(whole | {"name": "b"}))
        change(other)
        Path("b.json").write_text(json.dumps(other))
        capsys.readouterr()
        assert run("page", "a.json", "b.json") == 2
        assert message in capsys.readouterr().err
        assert not Path("suite.html").exists()

    refused(lambda row: row.update(name="answers"), "two rows are called 'answers'")
    refused(lambda row: row.update(suite="v2"), "row of suite 'v2', schema 1, expected v1, 1")
    refused(lambda row: row.update(tolerance=0.5), "scored on test, 0.5 s, expected test, 0.02 s")
    refused(lambda row: row["results"].pop("hospital-1"), "scored on 2 recordings")
    refused(lambda row: row["results"]["hospital-1"].update(fingerprint="x"), "is another recording")
    refused(lambda row: row["results"].update(x=row["results"]["hospital-1"]), "no recording of v1: 'x'")
    refused(lambda row: row["results"]["hospital-1"]["metrics"].update(ate_rmse=1e999), "no finite number")


# Statistics


def test_a_failure_ranks_last_and_is_never_dropped() -> None:
    inf = np.inf
    ranks = mean_ranks([[0.1, 0.1, 0.1], [0.2, 0.2, 0.05], [0.01, inf, inf]])
    assert ranks == pytest.approx([5 / 3, 2.0, 7 / 3])
    assert mean_ranks([[inf, 1.0], [inf, 2.0]]) == [1.25, 1.75]


def test_paired_tests_by_hand() -> None:
    """Six wins of six: p = 2 / 2⁶; Holm multiplies the smallest of three by 3."""
    good, bad = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.2, 0.4, 0.6, 0.8, 1.0, np.inf]
    (pair,) = compare([bad, good])
    assert (pair.a, pair.b, pair.wins, pair.losses) == (1, 0, 6, 0)
    assert pair.p == pytest.approx(2 / 2**6)
    three = compare([bad, good, good])
    assert [one.p for one in three] == pytest.approx([3 / 32, 3 / 32, 1.0])
    assert compare([good, good])[0].p == 1.0
    assert friedman([bad, good]) is None
    assert friedman([bad, good, good]) == pytest.approx(np.exp(-6.0))  # χ²₂ of 12 after ties


# The version


def test_train_and_test_are_apart_and_every_trap_is_told() -> None:
    test, train = ({e.seed for e in suite().entries if e.split == split} for split in ("test", "train"))
    assert max(test) < 10
    assert min(train) >= 100  # seeds below are reported on
    assert {entry.scenario for entry in suite().entries} == suite().traps.keys()
    assert suite().frozen.keys() == {entry.name for entry in suite().entries}


def test_a_fingerprint_sees_every_number(drives: dict[str, Recording]) -> None:
    drive = drives["hospital-0"]
    assert drive.truth is not None
    others = [
        replace(drive, truth=drive.truth + 1e-15),
        replace(drive, time=drive.time * (1.0 + 1e-15)),
        replace(drive, dead_reckoning=drive.dead_reckoning + 1e-15),
        replace(drive, ranges=np.where(np.arange(181) == 3, np.nan, drive.ranges)),
        replace(drive, laser=replace(drive.laser, range_max=19.0)),
        replace(drive, source="ins"),
    ]
    known = {fingerprint(one) for one in [drive, *others]}
    assert len(known) == 7
    assert fingerprint(replace(drive, name="other")) in known


def test_recordings_are_those_that_were_frozen() -> None:
    """A change of the simulator that changes them makes another version of the suite."""
    made, here = suite().made_with, environment()
    packages = {name: here["packages"][name] for name in ("numpy", "numba", "pymunk")}  # type: ignore[index]
    if made != {"processor": here["processor"], **packages}:
        pytest.skip(f"the suite was frozen with {made}: other machines may differ in the last bit")
    drive = simulate(CATALOGUE["corridor"], 0).recording
    assert fingerprint(drive) == suite().frozen["corridor-0"]
