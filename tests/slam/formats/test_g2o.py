"""g2o pose graphs: by hand, round trip, and the published ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.formats import FormatError, g2o
from slam.graph.pose_graph import PoseGraph, chi_squared, optimise

TRIANGLE = """VERTEX_SE2 7 0 0 0
VERTEX_SE2 3 1 0 0.5
FIX 7
VERTEX_SE2 5 1 1 -0.5
EDGE_SE2 7 3 1 0 0.5 11 12 13 22 23 33
EDGE_SE2 5 7 -1 -1 0.25 1 0 0 1 0 1
"""


def test_by_hand(tmp_path: Path) -> None:
    (tmp_path / "a.g2o").write_text(TRIANGLE)
    graph = g2o.read(tmp_path / "a.g2o")
    np.testing.assert_array_equal(graph.poses, [[0, 0, 0], [1, 0, 0.5], [1, 1, -0.5]])
    np.testing.assert_array_equal(graph.edges, [[0, 1], [2, 0]])
    np.testing.assert_array_equal(graph.T_ij, [[1, 0, 0.5], [-1, -1, 0.25]])
    np.testing.assert_array_equal(graph.information[0], [[11, 12, 13], [12, 22, 23], [13, 23, 33]])


@pytest.mark.parametrize("edges", [0, 5])
def test_round_trip_keeps_every_digit(tmp_path: Path, edges: int) -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(edges, 3, 3))
    graph = PoseGraph(
        poses=rng.normal(0, 100, (6, 3)),
        edges=rng.integers(0, 6, (edges, 2)),
        T_ij=rng.normal(size=(edges, 3)),
        information=root @ np.swapaxes(root, -1, -2),
    )
    g2o.write(tmp_path / "a.g2o", graph)
    found = g2o.read(tmp_path / "a.g2o")
    np.testing.assert_array_equal(found.poses, graph.poses)
    np.testing.assert_array_equal(found.edges, graph.edges)
    np.testing.assert_array_equal(found.T_ij, graph.T_ij)
    upper = np.triu_indices(3)
    np.testing.assert_array_equal(found.information[:, *upper], graph.information[:, *upper])


def test_edges_alone_give_a_first_guess(tmp_path: Path) -> None:
    """Four steps round a square and a loop, of vertices 10 to 13 and, apart from them, 2 and 1."""
    edges = [
        (11, 10, -1, 0, 0),
        (11, 12, 0, 1, np.pi / 2),
        (12, 13, 0, 1, 0),
        (13, 10, 1, 0, -np.pi / 2),
        (2, 1, 5, 0, 0),
    ]
    (tmp_path / "a.g2o").write_text(
        "".join(f"EDGE_SE2 {i} {j} {x} {y} {yaw} 1 0 0 1 0 1\n" for i, j, x, y, yaw in edges)
    )
    graph = g2o.read(tmp_path / "a.g2o")
    assert graph.edges.tolist() == [[3, 2], [3, 4], [4, 5], [5, 2], [1, 0]]
    np.testing.assert_allclose(graph.poses[:4], [[0, 0, 0], [-5, 0, 0], [0, 0, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(graph.poses[4], [1, 1, np.pi / 2], atol=1e-12)


def test_the_older_format_of_toro(tmp_path: Path) -> None:
    text = "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 11 12 22 33 13 23\n"
    (tmp_path / "a.graph").write_text(text)
    graph = g2o.read(tmp_path / "a.graph")
    np.testing.assert_array_equal(graph.information[0], [[11, 12, 13], [12, 22, 23], [13, 23, 33]])


def test_published_edges_alone_and_from_far_off_end_as_well(shared_data: Path, tmp_path: Path) -> None:
    published = g2o.read(shared_data / "posegraph/intel.g2o")
    g2o.write(tmp_path / "all.g2o", published)
    lines = (tmp_path / "all.g2o").read_text().splitlines(keepends=True)
    (tmp_path / "edges.g2o").write_text("".join(line for line in lines if line.startswith("EDGE")))
    astray = replace(published, poses=np.zeros_like(published.poses))
    for graph in (published, g2o.read(tmp_path / "edges.g2o"), astray):
        assert chi_squared(graph, optimise(graph).poses).sum() == pytest.approx(45.004, abs=1e-3)


def test_gtsam_reads_what_we_write(tmp_path: Path) -> None:
    import gtsam

    information = np.array([[4.0, 1.0, 0.5], [1.0, 5.0, 0.2], [0.5, 0.2, 6.0]])
    graph = PoseGraph(
        poses=np.array([[0.0, 0, 0], [1, 2, 0.3]]),
        edges=np.array([[0, 1]]),
        T_ij=np.array([[1.0, 2.1, 0.3]]),
        information=information[None],
    )
    g2o.write(tmp_path / "a.g2o", graph)
    factors, values = gtsam.readG2o(str(tmp_path / "a.g2o"), False)
    factor = factors.at(0)
    np.testing.assert_allclose(factor.noiseModel().covariance(), np.linalg.inv(information), atol=1e-12)
    measured = factor.measured()
    np.testing.assert_allclose([measured.x(), measured.y(), measured.theta()], [1, 2.1, 0.3])
    np.testing.assert_allclose(values.atPose2(1).translation(), [1, 2])


@pytest.mark.parametrize(("name", "poses", "edges"), [("intel", 1728, 2512), ("MIT", 808, 827)])
def test_published_graphs(shared_data: Path, name: str, poses: int, edges: int) -> None:
    graph = g2o.read(shared_data / f"posegraph/{name}.g2o")
    assert graph.poses.shape == (poses, 3)
    assert graph.edges.shape == (edges, 2)
    assert (np.linalg.eigvalsh(graph.information) > 0).all()
    # Consecutive poses start out as the odometry edges between them say.
    odometry = graph.edges[:, 1] == graph.edges[:, 0] + 1
    predicted = se2.between(graph.poses[graph.edges[:, 0]], graph.poses[graph.edges[:, 1]])
    error = se2.log(se2.between(graph.T_ij, predicted))[odometry]
    assert np.median(np.abs(error)) < 1e-3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("# nothing\n", "no VERTEX_SE2 and no EDGE_SE2"),
        ("EDGE_SE2 a b 1 0 0 1 0 0 1 0 1\n", ":1: vertex is 'a', expected a whole number"),
        (TRIANGLE + "EDGE_SE2 3 5 1 0 0 -1 0 0 1 0 1\n", ":7: the information of the edge is not positive"),
        (TRIANGLE + "VERTEX_XY 9 1 1\n", ":7: 'VERTEX_XY', expected VERTEX_SE2 or EDGE_SE2"),
        ("VERTEX_SE2 0 1 2\n", ":1: VERTEX_SE2 of 3 values, expected 4"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", ":1: 'VERTEX_SE3:QUAT', expected VERTEX_SE2 or EDGE_SE2"),
        (TRIANGLE + "VERTEX_SE2 3 0 0 0\n", ":7: vertex 3 a second time"),
        (TRIANGLE + "EDGE_SE2 3 9 1 0 0 1 0 0 1 0 1\n", ":7: edge to vertex 9, which is not in the file"),
        (TRIANGLE + "EDGE_SE2 3 5 1 0 0 1 0 0 1 0\n", ":7: EDGE_SE2 of 10 values, expected 11"),
        (TRIANGLE + "EDGE_SE2 3 5 1 0 0 1 0 0 1 0 nan\n", ":7: edge: value 9 is 'nan'"),
    ],
)
def test_bad_input(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.g2o").write_text(text)
    with pytest.raises(FormatError, match=message):
        g2o.read(tmp_path / "a.g2o")
