"""The audit of published patches: on patches made here, and on those of the thesis."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scenarios.report import __main__ as command
from scenarios.report.audit import FILE, Patches, audit, read, run
from slam import se2
from slam.cli import InputError


def patches(lost: set[int], unmatched: set[int], n: int = 40) -> Patches:
    """A straight drive, 0.25 m a patch; at the ``lost`` ones the map jumps aside, and the more sure the
    matcher is the more matches it has."""
    truth = np.stack([0.25 * np.arange(n), np.zeros(n), np.zeros(n)], axis=1)
    steps = se2.between(truth[:-1], truth[1:])
    slam = [truth[0]]
    for k, step in enumerate(steps, start=1):
        slam.append(se2.compose(slam[-1], step + ([0.0, 0.3, 0.0] if k in lost else [0.0, 0.0, 0.0])))
    matches = np.array([0.0 if k in unmatched else 5.0 if k in lost else 100.0 + k for k in range(n)])
    with np.errstate(divide="ignore"):
        sigma = np.where(matches > 0, 1e3 / matches, np.nan)
    covariance = sigma[:, None, None] ** 2 * np.eye(3)
    return Patches(covariance, matches, np.ones(n, dtype=bool), np.array(slam), truth)


def written(folder: Path, some: Patches) -> Path:
    """As the thesis publishes them: millimetres, a list without brackets, a comma behind every patch."""
    records = []
    for k in range(len(some.matches)):
        poses = {}
        for name, pose in (("slam", some.slam[k]), ("groundtruth", some.truth[k])):
            poses[name] = {"x": 1e3 * pose[0], "y": 1e3 * pose[1], "yaw": pose[2]}
        records.append(
            {
                **poses,
                "covariance": some.covariance[k].ravel().tolist(),
                "matches": some.matches[k],
                "extend": bool(some.extends[k]),
            }
        )
    folder.mkdir(exist_ok=True)
    (folder / FILE).write_text(",".join(json.dumps(record) for record in records) + ",\n")
    return folder


def test_scores_by_hand() -> None:
    found = audit(patches(lost={5, 9, 20}, unmatched={9, 30}))
    assert (found.steps, found.lost, found.unmatched) == (39, 3, 2)
    assert (found.zero_rule.right, found.zero_rule.wrong, found.zero_rule.missed) == (1, 1, 2)
    # Two lost steps are the worst of the matched ones; +inf holds one lost and one that is not.
    assert found.scores["trace"][2] == 1.0
    assert found.scores["matches"][0] == pytest.approx((2 * 35 + 35.5) / (3 * 36))


def test_failures_as_zero_variance_become_the_most_certain() -> None:
    found = audit(patches(lost={5, 9}, unmatched={9, 30, 31, 32}))
    assert found.as_lost["matches and trace"] == pytest.approx(-1.0)
    assert found.as_zero["matches and trace"] > -0.8
    assert found.as_zero["trace and det"] == found.as_lost["trace and det"] == pytest.approx(1.0)
    assert found.labels_swapped is None


def test_patches_are_read_as_published(tmp_path: Path) -> None:
    some = patches({5}, {9})
    again = read(written(tmp_path, some) / FILE)
    np.testing.assert_allclose(again.slam, some.slam)
    np.testing.assert_array_equal(again.matches, some.matches)
    np.testing.assert_array_equal(np.isnan(again.covariance), np.isnan(some.covariance))
    out = tmp_path / "audit.txt"
    told = run([tmp_path], out)
    assert "1 of 39 steps" in told
    assert "not the patches whose correlations the thesis prints" in told
    assert out.read_text() == told + "\n"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [("{", "list of patches"), ('{"matches": 1},', "covariance"), ('{"covariance": [1, 2]},', "patches")],
)
def test_a_file_that_is_something_else_is_told_of(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(InputError, match=complaint):
        read(tmp_path / FILE)


def test_nothing_to_tell_apart_is_told_of() -> None:
    with pytest.raises(InputError, match="nothing to tell apart"):
        audit(patches(lost=set(), unmatched=set()))


def test_the_correlations_of_the_thesis_and_what_the_truth_says(shared_data: Path) -> None:
    found = audit(read(shared_data / "usarsim/iro2012-pre2" / FILE))
    pairs = ("trace and det", "matches and det", "matches and trace")
    assert [round(found.as_zero[pair], 3) for pair in pairs] == [0.851, -0.481, -0.498]
    assert [round(found.as_lost[pair], 3) for pair in pairs] == [0.851, -0.665, -0.682]
    assert found.labels_swapped is True
    assert (found.steps, found.lost) == (181, 17)
    assert [round(score[0], 3) for score in found.scores.values()] == [0.951, 0.945, 0.965]
    assert [round(score[1], 3) for score in found.scores.values()] == [0.855, 0.816, 0.836]
    assert round(found.zero_rule.precision, 2) == 0.90
    assert round(found.zero_rule.recall, 2) == 0.53


def test_the_other_log_is_not_the_printed_one(shared_data: Path) -> None:
    found = audit(read(shared_data / "usarsim/smoke-results" / FILE))
    assert found.labels_swapped is None
    assert (found.steps, found.lost) == (1001, 111)


def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = written(tmp_path / "log", patches({5}, {9}))
    monkeypatch.setattr("sys.argv", ["report", "audit", str(folder)])
    assert command.main(command.Options, command.COMMAND, command.run) == 0
    assert "matches and trace" in capsys.readouterr().out
    monkeypatch.setattr("sys.argv", ["report", "audit", str(tmp_path)])
    assert command.main(command.Options, command.COMMAND, command.run) == 2
    said = capsys.readouterr().err
    assert "no such file" in said
    assert said.count("\n") == 1
