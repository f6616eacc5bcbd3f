"""The content of the live map."""

from __future__ import annotations

import base64
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.evaluation.segmentation import segment_gaps
from scenarios.report.chapter3 import points_on, rasterise_points, rooms
from scenarios.report.live import (
    GAPS,
    MAX_SCANS,
    MEMORY,
    drive_content,
    fitting_beams,
    live_content,
    map_image,
    pack,
    pack_bits,
    script_safe,
    shown_rows,
    stitch_entry,
)
from scenarios.report.stitches import RESOLUTION, AlignedPair, Walls, merged_walls
from scenarios.report.trajectory_figures import ellipses, to_map_axes
from slam import se2
from slam.mapping.occupancy import Grid
from slam.recording import Laser, Recording
from stitch.alignment.result import NoStitch, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate


def unpacked(told: dict) -> np.ndarray:
    """What the page's script makes of a packed array."""
    raw = np.frombuffer(base64.b64decode(told["data"]), dtype=f"<{told['kind']}")
    if told["kind"] == "f4":
        return raw.astype(float)
    return np.where(raw == GAPS[told["kind"]], np.nan, raw * told["scale"])


@pytest.mark.parametrize(("kind", "scale"), [("f4", 1.0), ("i2", 0.01), ("u2", 0.005), ("u1", 1 / 254)])
def test_packed_numbers_come_back_to_the_rounding(kind, scale):
    values = np.array([0.0, 0.25, 0.5, 1.0, np.nan])
    np.testing.assert_allclose(unpacked(pack(values, kind, scale)), values, atol=0.5 * scale)


def test_what_is_too_large_is_cut_off_and_infinity_is_nothing():
    assert unpacked(pack([1e9, -1e9, np.inf], "i2", 0.01))[:2].tolist() == [327.67, -327.67]
    assert np.isnan(unpacked(pack([np.inf], "u2")))[0]
    assert unpacked(pack([1e9, -5.0], "u1")).tolist() == [254.0, 0.0]


@given(st.integers(1, 5), st.integers(1, 40), st.randoms())
def test_bits_are_read_from_the_highest_of_each_row(rows, columns, random):
    flags = np.array([[random.random() < 0.5 for _ in range(columns)] for _ in range(rows)])
    content = pack_bits(flags)
    data = base64.b64decode(content["data"])
    for row in range(rows):
        for column in range(columns):
            byte = data[row * content["row"] + (column >> 3)]
            assert bool(byte >> (7 - (column & 7)) & 1) == flags[row, column]


def test_json_in_a_script_cannot_end_it():
    content = {"a": "</script><!--", "b": "x\u2028&"}
    text = script_safe(content)
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == content


@pytest.fixture
def recording() -> Recording:
    """A robot at rest before a wall; from scan 10 on half of its beams see a wall half a metre nearer."""
    angles = np.linspace(-0.5, 0.5, 40)
    ranges = np.tile(2.0 / np.cos(angles), (20, 1))
    ranges[10:, :20] -= 0.5
    ranges[:, 39] = np.nan
    poses = np.zeros((20, 3))
    poses[:, 1] = 0.01 * np.arange(20)
    return Recording("r", np.arange(20.0), ranges, angles, Laser(), poses, truth=poses)


def test_beams_fit_what_was_seen_before(recording):
    fits = fitting_beams(recording, recording.truth, np.array([0, 5, 10]))
    assert not fits[0].any()  # nothing was seen before the first scan
    assert fits[1, :39].all()
    assert not fits[2, :20].any()
    assert fits[2, 20:39].all()
    assert not fits[:, 39].any()  # no return, nothing to fit


def test_what_was_seen_long_ago_is_forgotten(recording):
    turned = recording.truth + np.array([0.0, 0.0, 1.0]) * np.arange(20)[:, None]  # each scan is a keyframe
    back = turned.copy()
    back[19] = turned[0]
    assert len(turned) <= MEMORY + 1
    assert fitting_beams(recording, back, np.array([19]))[0, 25:39].all()
    many = replace(
        recording, time=np.arange(60.0), ranges=np.repeat(recording.ranges[:1], 60, 0),
        dead_reckoning=np.zeros((60, 3)), truth=None,
    )  # fmt: skip
    away = np.column_stack([np.zeros(60), 0.5 * np.arange(60), np.zeros(60)])
    away[59] = away[0]
    assert not fitting_beams(many, away, np.array([59])).any()


def test_long_drives_are_shown_in_part():
    n = 2 * MAX_SCANS + 1
    still = Recording("r", np.arange(n), np.ones((n, 2)), np.array([0.0, 0.1]), Laser(), np.zeros((n, 3)))
    rows = shown_rows(still)
    assert rows.tolist() == list(range(0, n, 3))
    content = drive_content(still, rows, None)
    assert len(unpacked(content["time"])) == len(rows)
    assert len(unpacked(content["ranges"])) == 2 * len(rows)
    assert content["tilt"] is None


def test_maps_have_north_up_and_lie_in_their_place():
    import cv2

    occupied, free = np.zeros((2, 3, 4), dtype=bool)
    occupied[0, 1], free[2, 3] = True, True
    content = map_image(Grid(occupied, free, np.array([-1.0, 2.0]), 0.5))
    assert content["corners"] == [-1.0, 2.0, 1.0, 3.5]
    data = np.frombuffer(base64.b64decode(content["image"].partition(",")[2]), dtype=np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    assert (picture[2, 1], picture[0, 3], picture[0, 0]) == (255, 128, 0)


def test_the_ellipse_holds_95_per_cent_and_lies_along_the_covariance():
    pose = np.array([[1.0, 2.0, np.pi / 2]])
    body = np.diag([4.0, 1.0, 0.1])[None]  # twice as unsure ahead, which is north here
    (outline,) = ellipses(pose, to_map_axes(pose, body))
    reach = np.abs(outline - pose[0, :2]).max(axis=0)
    np.testing.assert_allclose(reach, np.sqrt(5.9915) * np.array([1.0, 2.0]), rtol=1e-5)
    (larger,) = ellipses(pose, to_map_axes(pose, body), 10.0)
    np.testing.assert_allclose(larger - pose[0, :2], 10.0 * (outline - pose[0, :2]), atol=1e-12)


WALLS = points_on(rooms())
T = np.array([0.6, -0.4, np.radians(30.0)])


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    """Two submaps of the same rooms, the second seen from ``T``, and three stitches of them."""
    a, b = rasterise_points(WALLS), rasterise_points(se2.transform(se2.inverse(T), WALLS))
    b = replace(b, start=5, stop=9, anchor=np.array([1.0, 0.0, 0.0]))
    right = Stitch(T, 1e-4 * np.eye(3), 3.0, 5.0, 0.9)
    tried = (
        LoopCandidate(0, 1, right, 1.0),
        LoopCandidate(0, 1, replace(right, T_a_b=T + np.array([1.0, 0.0, 0.0])), 1.0),
        LoopCandidate(0, 1, right, 0.1),
        LoopCandidate(0, 1, NoStitch("no candidate")),
    )
    poses = np.zeros((9, 3))
    poses[5:] = T
    return Estimate("m", poses, submaps=(a, b), stitches=tried)


def test_every_stitch_tells_what_became_of_it(estimate):
    found = [stitch_entry(estimate, stitch, estimate.poses) for stitch in estimate.stitches]
    assert [one["state"] for one in found] == ["accepted", "false", "rejected", "refused"]
    assert found[1]["error"][0] == pytest.approx(1.0)
    assert found[0]["before"] == [1.0, 0.0, 0.0]
    assert found[3]["reason"] == "no candidate"
    assert "evidence" not in found[3]
    blind = [stitch_entry(estimate, stitch, None)["state"] for stitch in estimate.stitches]
    assert blind == ["accepted", "accepted", "rejected", "refused"]


def test_the_evidence_peaks_at_the_true_alignment(estimate):
    a, b = (Walls(submap.grid.occupied_points(), submap.grid) for submap in estimate.submaps)
    pair = AlignedPair(a, b, np.zeros(3), T)
    correlation = pair.rotation_correlation()
    assert correlation.max() == 1.0
    assert correlation[30] > 0.9
    for axis in pair.axis_spectra():
        first, correlation = axis.correlation
        best = first + RESOLUTION * int(np.argmax(correlation))
        assert best == pytest.approx(axis.shift, abs=2 * RESOLUTION)
    score, first = pair.score_surface()
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    np.testing.assert_allclose(first + RESOLUTION * np.array([column, row]), T[:2], atol=2 * RESOLUTION)
    assert replace(pair, a=replace(a, grid=None)).score_surface() is None


def test_a_piece_of_htms_is_shown_with_all_before_it(estimate):
    htms = replace(
        estimate, method="htms", stitches=(*estimate.stitches[:1], LoopCandidate(0, 2, NoStitch("x")))
    )
    before = merged_walls(htms, 2).points
    assert len(before) > len(merged_walls(htms, 1).points)
    off = np.abs(before[:, None] - WALLS[None, ::5]).sum(axis=2).min(axis=1)
    assert np.quantile(off, 0.95) < 3 * RESOLUTION


def test_touching_submaps_are_no_cut(estimate):
    a, b = estimate.submaps
    assert segment_gaps([a, b]) == [(1, 4)]
    assert segment_gaps([a, replace(b, start=1)]) == []
    assert segment_gaps([a]) == []


def test_a_method_that_lost_itself_has_no_map(recording):
    far = recording.truth * 1e9 + np.array([0.0, 1.0, 0.0]) * np.arange(20)[:, None] * 1e6
    (method,) = live_content(replace(recording, truth=None), [Estimate("lost", far)], None, None)["methods"]
    assert method["map"] is None
