"""The bench of the matchers: pairs that are what they say, scores known by hand, the bound, the command."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from scenarios.bench import __main__ as command
from scenarios.bench.matching import calibration, cost, matchers
from scenarios.bench.matching import pairs as making
from scenarios.bench.matching.matchers import ABLATION, OURS, VARIANTS, Variant
from scenarios.bench.matching.scores import Matcher, PoseEstimate, measure, score
from scenarios.report import corridor
from slam import se2
from slam.cli import main
from slam.matching import Match, NoMatch
from slam.recording import Recording

# Scores


def pair_at(T, truth_covariance=None) -> making.Pair:
    """A pair of which only the true pose counts."""
    covariance = np.zeros((3, 3)) if truth_covariance is None else truth_covariance
    poses = np.array([[0.0, 0.0, 0.0], T])
    return making.Pair(np.zeros((2, 1)), np.zeros(1), making.LASER, poses, covariance)


SIGMA = np.diag([0.01, 0.01, 0.001]) ** 2


def test_a_singular_covariance_claims_what_it_cannot_know():
    truth = np.array([1.0, 2.0, 0.0])
    certain = np.diag([0.0, 1e-4, 1e-6])  # of x, as UsarCommander's can be
    found = score([pair_at(truth)], [PoseEstimate(se2.compose(truth, [0.2, 0.0, 0.0]), certain)], np.ones(1))
    assert found.silent == 1.0
    assert found.anees is not None
    assert 1e6 < found.anees < np.inf


def test_a_covariance_lost_to_rounding_is_scored():
    """One direction of 10¹², as UsarCommander's can be, and nothing left of the others."""
    v = np.array([1.1, 0.74, -2.65])
    truth = np.array([1.0, 2.0, 0.0])
    found = score([pair_at(truth)], [PoseEstimate(truth, 1e12 * np.outer(v, v))], np.ones(1))
    assert found.silent == 0.0
    assert found.anees == pytest.approx(0.0)


def test_scores_known_by_hand():
    truth = np.array([1.0, 2.0, 0.5 * np.pi])
    pair = pair_at(truth)
    answers = [
        PoseEstimate(truth, SIGMA),  # exact: 0
        PoseEstimate(se2.compose(truth, [0.03, 0.0, 0.0]), SIGMA),  # success, χ² 9
        PoseEstimate(se2.compose(truth, [0.0, 0.2, 0.0]), SIGMA),  # silent failure, χ² 400
        PoseEstimate(se2.compose(truth, [0.2, 0.0, 0.0]), 100.0 * SIGMA),  # covered failure, χ² 4
        NoMatch("nothing there"),
    ]
    found = score([pair] * 5, answers, np.array([1.0, 2.0, 3.0, 4.0, 10.0]) * 1e-3)
    assert found.success == pytest.approx(2 / 5)
    assert found.silent == pytest.approx(1 / 5)
    assert found.no_match == pytest.approx(1 / 5)
    assert found.anees == pytest.approx((0 + 9 + 400 + 4) / 4 / 3)
    assert found.anees_median == pytest.approx((4 + 9) / 2 / chi2.median(3))
    assert found.rms_m == pytest.approx(0.03 / np.sqrt(2.0))
    assert found.rms_rad == pytest.approx(0.0, abs=1e-12)
    assert (found.ms, found.ms_95) == (pytest.approx(3.0), pytest.approx(8.8))


def test_a_turn_of_three_degrees_is_a_failure():
    answer = PoseEstimate(np.array([0.0, 0.0, np.radians(3.0)]), SIGMA)
    found = score([pair_at([0.0, 0.0, 0.0])], [answer], np.ones(1))
    assert (found.success, found.silent) == (0.0, 1.0)
    assert found.rms_m is None


def test_the_error_is_in_the_body_frame_of_the_answer():
    """Sure along the robot's x: an error there is not covered, one along its y is."""
    truth, sure_along_x = np.array([0.0, 0.0, 0.5 * np.pi]), np.diag([0.01, 1.0, 1.0]) ** 2
    for offset, silent in (([0.0, 0.3, 0.0], 1.0), ([0.3, 0.0, 0.0], 0.0)):  # the robot's x is the world's y
        answer = PoseEstimate(truth + offset, sure_along_x)
        assert score([pair_at(truth)], [answer], np.ones(1)).silent == silent


def test_the_truths_own_uncertainty_counts():
    answer = PoseEstimate(np.array([0.12, 0.0, 0.0]), SIGMA)
    assert score([pair_at([0.0, 0.0, 0.0])], [answer], np.ones(1)).silent == 1.0
    loose = score([pair_at([0.0, 0.0, 0.0], 15.0 * SIGMA)], [answer], np.ones(1))
    assert loose.silent == 0.0
    assert loose.anees == pytest.approx(144.0 / 16.0 / 3.0)


def test_who_claims_no_covariance_is_not_scored_for_it():
    found = score([pair_at([0.0, 0.0, 0.0])], [PoseEstimate(np.zeros(3), None)], np.ones(1))
    assert (found.silent, found.anees, found.anees_median) == (None, None, None)


def test_without_any_answer_there_is_nothing_to_average():
    found = score([pair_at([0.0, 0.0, 0.0])], [NoMatch("no")], np.ones(1))
    assert (found.success, found.no_match, found.silent, found.anees) == (0.0, 1.0, 0.0, None)


def test_no_pairs_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        score([], [], np.empty(0))


@pytest.mark.parametrize(
    ("successes", "low", "high"), [(0, 0.0, 0.2775), (5, 0.2366, 0.7634), (10, 0.7225, 1.0)]
)
def test_wilsons_interval_of_ten(successes, low, high):
    results = [PoseEstimate(np.zeros(3), None)] * successes + [NoMatch("no")] * (10 - successes)
    ten = score([pair_at([0.0, 0.0, 0.0])] * 10, results, np.ones(10))
    assert (ten.success_low, ten.success_high) == pytest.approx((low, high), abs=1e-4)


def test_every_variant_answers(built):
    truth = np.array([p.T_reference_scan for p in built.pairs[:2]])
    names = [variant.name for variant in (*VARIANTS, *ABLATION)]
    assert len(set(names)) == len(names)
    for variant in (*VARIANTS, *ABLATION):
        found = measure(variant.matcher, built.pairs[:2], truth)
        assert found.no_match == 0.0
        assert found.silent is not None


# Calibration


def test_trials_average_errors_and_claims():
    errors = np.array([[0.03, 0.0, 0.0], [0.0, 0.04, 0.002]])
    t = calibration.Trials(errors, np.stack([SIGMA, 4.0 * SIGMA]))
    np.testing.assert_allclose(t.rms, [0.03 / np.sqrt(2), 0.04 / np.sqrt(2), 0.002 / np.sqrt(2)])
    np.testing.assert_allclose(t.claimed, np.sqrt(2.5) * np.array([0.01, 0.01, 0.001]))
    assert t.anees == pytest.approx((9.0 + (16.0 + 4.0) / 4.0) / 2.0 / 3.0)


def test_along_a_corridor_only_p2l_says_that_it_knows_nothing():
    rng = np.random.default_rng(100)
    pairs = calibration.pairs_at("corridor", 10, rng)
    guesses = calibration.seeded(pairs, rng)
    along = {
        mode: calibration.trials(Variant("wsm", "wsm", mode, calibration.PLAIN), pairs, guesses).claimed[0]
        for mode in ("joint", "pfister_block", "p2l")
    }
    assert along["p2l"] > 0.5
    assert max(along["joint"], along["pfister_block"]) < 0.02


def test_errors_are_turned_to_the_axes_of_the_world():
    np.testing.assert_allclose(calibration.turned(0.5 * np.pi) @ [1.0, 0.0, 2.0], [0.0, 1.0, 2.0], atol=1e-12)


# Peers, time and memory


def test_peers_that_are_not_installed_say_how(monkeypatch):
    monkeypatch.setattr(matchers, "find_spec", lambda name: None)
    missing = dict.fromkeys(("small_gicp", "open3d"), matchers.INSTALL)
    assert matchers.third_party_matchers() == ({}, missing)


def test_a_peer_that_cannot_be_imported_says_why(monkeypatch):
    def broken(name):
        raise ImportError("libusb-1.0.so.0: cannot open shared object file")

    monkeypatch.setattr(matchers, "find_spec", lambda name: object())
    monkeypatch.setattr(matchers, "import_module", broken)
    assert "libusb" in matchers.third_party_matchers()[1]["open3d"]


def test_small_gicp_finds_what_it_should(built):
    small_gicp = pytest.importorskip("small_gicp")
    truth = np.array([p.T_reference_scan for p in built.pairs])
    matcher = matchers.small_gicp_matchers(small_gicp)[matchers.GICP]
    assert measure(matcher, built.pairs, truth).success == 1.0


def test_points_of_peers_are_those_of_our_scans(built):
    mounted = replace(built.pairs[0], laser=replace(making.LASER, T_robot_laser=np.array([0.1, 0.2, 0.3])))
    # As measured: ours are drawn to the line of their neighbours.
    np.testing.assert_allclose(matchers.points(mounted, 1), mounted.scans[1].points, atol=0.04)
    space = matchers.extruded(mounted, 1)
    assert space.shape == (3 * len(mounted.scans[1]), 3)
    assert set(space[:, 2]) == {-matchers.LAYERS, 0.0, matchers.LAYERS}


def test_poses_of_the_plane_survive_space():
    pose = np.array([1.0, -2.0, 0.7])
    np.testing.assert_allclose(matchers.to_plane(matchers.to_space(pose)), pose)
    x, y, z, _ = matchers.to_space(pose) @ [1.0, 2.0, 3.0, 1.0]
    np.testing.assert_allclose([[x, y]], se2.transform(pose, [[1.0, 2.0]]))
    assert z == 3.0


def test_what_is_ready_is_made_once_and_ranges_are_read_every_time(built):
    made: list[str] = []
    assert len(built.pairs[0].scans) == 2

    def read(pair, which):
        assert "scans" not in vars(pair)  # nothing read before the clock runs
        made.append("read")
        return which

    def prepare(which):
        made.append("prepare")
        return which

    def match(reference, scan, guess):
        made.append("match")
        return NoMatch(f"{reference}{scan}")

    found = cost.match_times({"a": Matcher(read, prepare, match)}, built.pairs[:1], np.zeros((1, 3)))
    assert made == ["read", "read", "prepare", "prepare", "match", "match"]
    assert 0.0 <= found["a"]["scans"] <= found["a"]["ranges"]


def test_the_long_drive_returns_to_where_it_was():
    drive = cost.round_and_round(2 * 40 * cost.LAP + 3, np.random.default_rng(0))
    np.testing.assert_array_equal(drive.ranges[:3], drive.ranges[40 * cost.LAP : 40 * cost.LAP + 3])
    np.testing.assert_allclose(drive.dead_reckoning[cost.LAP], drive.dead_reckoning[0], atol=1e-9)
    assert isinstance(drive, Recording)


# The command


def run_small(monkeypatch, *words: str) -> int:
    """The whole bench, as small as can be and without peers."""
    monkeypatch.setattr(calibration, "PAIRS", 3)
    for name, value in {
        "PLACES": 2,
        "MAP_SCANS": 3,
        "MATCHES": 2,
        "SHORT": 10,
        "LONG": 20,
        "RUNS": 1,
    }.items():
        monkeypatch.setattr(cost, name, value)
    monkeypatch.setattr(matchers, "find_spec", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["bench", "matching", "--pairs", "3", *words])
    return main(command.BenchmarkOptions, command.COMMAND, command.run)


def test_json_has_every_score(monkeypatch, capsys, logs):
    assert run_small(monkeypatch, "--data", str(logs), "--format", "json") == 0
    result = json.loads(capsys.readouterr().out)
    records = result["records"]["matching"]
    rows = {(r["matcher"], r["data"], r["guesses"]): r for r in records["scores"]}
    assert len(rows) == (len(VARIANTS) + len(ABLATION)) * 4 * 2
    assert rows["plicp", "simulated", "easy"]["success"] == 1.0
    assert rows["plicp", "simulated", "easy"]["pairs"] == 3
    assert {r["place"] for r in records["calibration"]} == {"room", "corridor"}
    assert {r["matcher"] for r in records["efficiency"]} == {variant.name for variant in VARIANTS}
    assert all(r["scans_ratio"] is None for r in records["speed"])
    figures = {f["name"]: f for f in result["benches"]["matching"]}
    assert figures["front end, Intel"]["median"] > 0.0
    assert figures["match against 20 scans"]["median"] > 0.0
    assert "small_gicp: not installed: pip install 'slamstitch[peers]'" in result["notes"]["matching"]


def test_without_logs_there_are_fewer_columns_and_a_line_for_each(monkeypatch, capsys, tmp_path):
    assert run_small(monkeypatch, "--data", str(tmp_path)) == 0
    out = capsys.readouterr().out
    assert "easy guesses" in out
    assert "simulated" in out
    assert " Intel  " not in out
    assert sum("is not there (--data names the folder)" in line for line in out.splitlines()) == 3
    assert max(map(len, (line.rstrip() for line in out.splitlines()))) <= 160


# The picture


def test_the_corridors_picture_is_a_png(monkeypatch, tmp_path):
    monkeypatch.setattr(corridor, "PAIRS", 4)
    out = corridor.run(tmp_path / "corridor.png")
    assert out.read_bytes().startswith(b"\x89PNG")


def test_ellipses_hold_95_percent():
    rng = np.random.default_rng(0)
    covariance = np.diag([4.0, 1.0, 1.0])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 2000)
    found = calibration.Trials(errors, np.broadcast_to(covariance, (2000, 3, 3)))
    assert corridor.coverage(found) == pytest.approx(0.95, abs=0.015)
    x, y = corridor.ellipse(covariance[:2, :2])
    np.testing.assert_allclose(x**2 / 4.0 + y**2, corridor.CHI2_2_95)


def test_answers_of_ours_are_matches(built):
    assert isinstance(OURS.match(*map(OURS.matcher.prepare, built.pairs[0].scans), np.zeros(3)), Match)
