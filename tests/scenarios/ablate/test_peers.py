"""What is handed to others, and what becomes of their answers."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from scenarios.ablate import peers
from scenarios.ablate.options import HalmstadOptions
from scenarios.ablate.study.halmstad import run
from slam.cli import InputError
from stitch.align import AlignConfig, NoStitch, Stitch
from tests.scenarios.ablate.tiny_pair import tiny_pair


@pytest.mark.parametrize("inliers", [peers.LEAST, peers.LEAST - 1])
def test_an_answer_with_too_few_inliers_is_refused(monkeypatch: pytest.MonkeyPatch, inliers: int) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = SimpleNamespace(rotation=turn, translation=[1.0, 2.0, 0.0])
    matcher = SimpleNamespace(estimate=lambda b, a: found, get_num_final_inliers=lambda: inliers)
    module = SimpleNamespace(
        KISSMatcher=lambda config: matcher, KISSMatcherConfig=lambda voxel, use_quatro: None
    )
    monkeypatch.setitem(sys.modules, "kiss_matcher", module)
    pair = tiny_pair()
    result = peers.align_kiss(pair.a, pair.b, None, AlignConfig())
    assert isinstance(result, Stitch if inliers == peers.LEAST else NoStitch)
    pose = result.T_a_b if isinstance(result, Stitch) else result.best.T_a_b  # type: ignore[union-attr]
    np.testing.assert_allclose(pose, [1.0, 2.0, 0.5 * np.pi])


def test_walls_stand_upright() -> None:
    cloud = np.array(peers.upright(np.array([[1.0, 2.0], [3.0, 4.0]])))
    assert cloud.shape == (2 * len(peers.HEIGHTS), 3)
    np.testing.assert_allclose(np.unique(cloud[:, 2]), peers.HEIGHTS, atol=1e-6)


def test_a_peer_that_is_absent_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "is_installed", lambda: False)
    with pytest.raises(InputError, match="KISS-Matcher is not installed"):
        run(HalmstadOptions(data=tmp_path, methods="kiss"))
