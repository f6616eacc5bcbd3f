import numpy as np
import pytest

from scenarios.evaluation.segmentation import stitch_error, stitch_metrics
from slam import se2
from slam.mapping.occupancy import Grid
from slam.mapping.submap import Submap
from slam.scan import Scan
from stitch.align import NoStitch, Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

TRUTH = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, np.pi / 2], [0, 2, np.pi]])


def submap(start: int, stop: int) -> Submap:
    empty, cells = np.zeros((0, 2)), np.zeros((1, 1), dtype=bool)
    scan = Scan(empty, empty, empty, np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, dtype=int))
    return Submap(start, stop, np.zeros(3), scan, Grid(cells, cells, np.zeros(2), 0.05))


def found(T_a_b) -> Stitch:
    return Stitch(np.array(T_a_b, dtype=float), np.eye(3), 1.0, 10.0, 0.8)


def estimate(*stitches: LoopCandidate) -> Estimate:
    return Estimate("htms", TRUTH, submaps=(submap(0, 2), submap(2, 4)), stitches=stitches)


def counts(est, truth=TRUTH):
    return stitch_metrics(est, truth)


def test_error_by_hand():
    """Truly 1 m ahead, 2 m left, a quarter turn; found 0.3 m and 0.4 m off and 3° further."""
    tried = LoopCandidate(0, 1, found([1.3, 2.4, np.pi / 2 + np.radians(3)]))
    error = stitch_error(estimate(tried), tried, TRUTH)
    assert error.translation == pytest.approx(0.5)
    assert np.degrees(error.rotation) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("offset", "false"), [((0.29, 0, 0), 0), ((0.31, 0, 0), 1), ((0, 0, 0.034), 0), ((0, 0, -0.036), 1)]
)
def test_false_beyond_30_cm_or_2_degrees(offset, false):
    stitch = found(se2.compose([1.0, 2.0, np.pi / 2], offset))
    assert counts(estimate(LoopCandidate(0, 1, stitch)))["stitches_false"] == false


def test_only_accepted_stitches_can_be_false():
    wrong = found([9.0, 9.0, 0.0])
    est = estimate(
        LoopCandidate(0, 1, wrong, weight=0.0),
        LoopCandidate(0, 1, NoStitch("no overlap")),
        LoopCandidate(0, 1, wrong, 1.0),
    )
    assert counts(est) == {"segments": 2, "stitches_tried": 3, "stitches_accepted": 1, "stitches_false": 1}


def test_no_alignment_has_no_error():
    tried = LoopCandidate(0, 1, NoStitch("no overlap"))
    assert stitch_error(estimate(tried), tried, TRUTH) is None


def test_without_truth_stitches_are_counted_but_not_judged():
    metrics = stitch_metrics(estimate(LoopCandidate(0, 1, found([0, 0, 0]))), None)
    assert metrics["stitches_accepted"] == 1
    assert metrics["stitches_false"] == "the recording has no truth"


def test_a_method_without_segments_says_so():
    metrics = stitch_metrics(Estimate("ins", TRUTH), TRUTH)
    assert set(metrics.values()) == {"the method does not cut the drive"}
