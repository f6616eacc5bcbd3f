"""Fixtures of every package: a furnished room, a bare corridor, drives through them, the shared data."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sim.laser import Raycaster
from slam import se2
from slam.odometry.confidence import MEASURES
from slam.odometry.track import Track, Verdict
from slam.recording import Laser, Recording
from slam.scan import Scan
from slam.se2 import Array

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
LASER = Laser(range_max=20.0, sigma_range=0.01)
ANGLES = np.radians(np.linspace(-90.0, 90.0, 181))


def _box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]]


@pytest.fixture(scope="session")
def room() -> Array:
    """Walls ``(S, 4)`` of 8 m x 6 m with two cupboards and two stubs of wall."""
    stubs = [[8.0, 3.0, 6.5, 3.0], [4.0, 6.0, 4.0, 5.2]]
    return np.array([*_box(0, 0, 8, 6), *_box(5, 1, 6, 2.2), *_box(2.5, 4, 3.3, 4.8), *stubs])


@pytest.fixture(scope="session")
def corridor() -> Array:
    """Two bare walls ``(2, 4)`` along x, 2 m apart, whose ends no laser sees."""
    return np.array([[-60.0, -1.0, 60.0, -1.0], [-60.0, 1.0, 60.0, 1.0]])


@pytest.fixture(scope="session")
def look() -> Callable[..., Scan]:
    """Scan in the robot's frame, seen from a pose among walls; noise-free without a generator."""

    def look(
        walls: Array, pose: Array, rng: np.random.Generator | None = None, angles: Array = ANGLES
    ) -> Scan:
        ranges = Raycaster.from_segments(walls).cast([pose], angles, LASER.range_max)[0]
        noise = 0.0 if rng is None else rng.normal(0.0, LASER.sigma_range, ranges.shape)
        return Scan.from_ranges(ranges + noise, angles, LASER)

    return look


@pytest.fixture(scope="session")
def record() -> Callable[..., Recording]:
    """Recording of a drive along true poses ``(N, 3)``; dead reckoning is the truth unless given."""

    def record(
        walls: Array,
        truth: Array,
        dead_reckoning: Array | None = None,
        noise: float = 0.01,
        seed: int = 0,
        angles: Array = ANGLES,
        **others: object,
    ) -> Recording:
        rng = np.random.default_rng(seed)
        truth = np.asarray(truth, dtype=float)
        ranges = Raycaster.from_segments(walls).cast(truth, angles, LASER.range_max)
        return Recording(
            name="test",
            time=0.2 * np.arange(len(truth)),
            ranges=ranges + rng.normal(0.0, noise, ranges.shape),
            angles=angles,
            laser=LASER,
            dead_reckoning=truth if dead_reckoning is None else dead_reckoning,
            truth=truth,
            **others,  # type: ignore[arg-type]
        )

    return record


@pytest.fixture(scope="session")
def straight() -> Callable[..., Array]:
    """True poses ``(n, 3)`` of a straight drive in the room."""

    def straight(n: int = 25, step: float = 0.12) -> Array:
        return np.column_stack([1.0 + step * np.arange(n), np.full(n, 3.2), np.zeros(n)])

    return straight


@pytest.fixture(scope="session")
def curve() -> Callable[..., Array]:
    """True poses ``(n, 3)`` of a turn by 2 rad in the room."""

    def curve(n: int = 30) -> Array:
        angle = np.linspace(0.0, 2.0, n)
        return np.column_stack([2.0 + 1.2 * np.sin(angle), 3.4 - 1.2 * np.cos(angle), angle])

    return curve


@pytest.fixture(scope="session")
def assert_consistent() -> Callable[[Track], None]:
    """What holds of every track; ManifoldSLAM's block covariances may be indefinite, as the published are."""

    def assert_consistent(found: Track) -> None:
        n = len(found)
        matched, skipped = found.verdict == Verdict.MATCHED, found.verdict == Verdict.SKIPPED
        assert np.all(np.isfinite(found.poses))
        assert np.all(np.abs(found.poses[:, 2]) <= np.pi)
        assert found.verdict[0] == Verdict.SKIPPED
        np.testing.assert_array_equal(found.reference[skipped], -1)
        assert np.all(found.reference[~skipped] < np.arange(n)[~skipped])
        assert np.all(found.reference[~skipped] >= 0)
        assert np.all(np.isnan(found.covariance[skipped]))
        assert np.all(np.isfinite(found.covariance[~skipped]))
        np.testing.assert_allclose(found.covariance, np.swapaxes(found.covariance, 1, 2), atol=1e-12)
        assert np.all(found.information[~matched] == 0.0)
        assert np.all(np.linalg.eigvalsh(found.information[matched])[:, -1] > 0.0)
        assert set(found.confidence) == set(MEASURES)
        for name, column in found.confidence.items():
            if name != "tilt":  # not every recording tells the attitude
                np.testing.assert_array_equal(np.isnan(column), skipped)

    return assert_consistent


@pytest.fixture(scope="session")
def hand_made() -> Callable[..., Track]:
    """Track made of poses ``(N, 3)`` and verdicts ``(N,)``; the rest says nothing unless given."""

    def hand_made(poses: Array, verdict: np.ndarray, **others: object) -> Track:
        n = len(poses)
        rest: dict[str, object] = {
            "reference": np.arange(-1, n - 1),
            "covariance": np.full((n, 3, 3), np.nan),
            "information": np.zeros((n, 3, 3)),
            "matches": np.zeros(n, dtype=np.int64),
            "confidence": {},
        }
        return Track(np.asarray(poses, dtype=float), np.asarray(verdict), **{**rest, **others})  # type: ignore[arg-type]

    return hand_made


@pytest.fixture(scope="session")
def rms() -> Callable[[Array, Array], float]:
    """Root mean square distance [m] of two paths ``(N, 3)``, both put at the origin by their first pose."""

    def rms(a: Array, b: Array) -> float:
        apart = se2.between(a[0], a)[:, :2] - se2.between(b[0], b)[:, :2]
        return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))

    return rms


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real recordings beside the checkout; the test is skipped where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("real recordings not found: expected the folder ../shared/data beside the checkout")
    return SHARED_DATA


EXPECTED_SKIPS = (
    "real recordings not found",  # the folder is not part of the repository
    "real recording not found",
    "rerun-sdk is not installed",  # extras that the tests do not install
    "could not import 'small_gicp'",
    "kiss-icp is not installed",  # peers
    "karto-scanmatcher is not installed",
    "mrpt-icp-slam is not installed",
    "no browser",  # where Debian's packages cannot be reached
)
"""What a skip's reason may begin with where ``CI`` is set; any other means that a test has got lost."""


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """An unexpected skip fails in continuous integration."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not os.environ.get("CI"):
        return
    reasons = {report.longrepr[2].removeprefix("Skipped: ") for report in reporter.stats.get("skipped", [])}
    lost = sorted(reason for reason in reasons if not reason.startswith(EXPECTED_SKIPS))
    if lost:
        reporter.write_line(f"unexpected skips: {'; '.join(lost)}", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
