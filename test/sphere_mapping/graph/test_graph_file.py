from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.graph.graph_file import read_graph, write_g2o
from sphere_mapping.graph.optimum import optimize
from sphere_nav.geometry import SE3, so3
from worlds.cylinder import cylinder

EDGE2 = "EDGE_SE2 0 1 1 0 0.1 4 1 0 9 0 16"


def saved(tmp_path, *lines):
    path = tmp_path / "graph.g2o"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("planar", [False, True])
def test_a_graph_is_read_as_it_was_written(tmp_path, planar):
    _, graph = cylinder(2, 6, (0.1, 0.05), planar=planar)
    graph = replace(graph, ids=graph.ids * 7 + 3)
    path = tmp_path / "graph.g2o"
    write_g2o(path, graph)
    found = read_graph(path)
    np.testing.assert_array_equal(found.ids, graph.ids)
    np.testing.assert_array_equal(found.ends, graph.ends)
    for name in ("poses", "motions", "information"):
        np.testing.assert_allclose(getattr(found, name), getattr(graph, name), atol=1e-9, rtol=1e-9)


def test_toro_in_the_plane_has_an_order_of_its_own(tmp_path):
    path = saved(tmp_path, "VERTEX2 5 0 0 0", "VERTEX2 9 1 2 0.5", "EDGE2 5 9 1 2 0.5 11 12 22 33 1.3 2.3")
    found = read_graph(path)
    np.testing.assert_array_equal(found.information[0], [[11, 12, 1.3], [12, 22, 2.3], [1.3, 2.3, 33]])
    np.testing.assert_allclose(found.motions[0], found.poses[1], atol=1e-12)


def test_toro_in_space_turns_by_yaw_then_pitch_then_roll(tmp_path):
    identity = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
    found = read_graph(saved(tmp_path, f"EDGE3 0 1 1 2 3 0.1 0.2 0.3 {identity}"))
    R = so3.exp([0, 0, 0.3]) @ so3.exp([0, 0.2, 0]) @ so3.exp([0.1, 0, 0])
    np.testing.assert_allclose(found.motions[0], SE3.from_parts(R, [1, 2, 3]).matrix, atol=1e-12)


def test_without_vertices_the_poses_are_chained(tmp_path):
    found = read_graph(saved(tmp_path, "# a comment", "FIX 0", EDGE2, EDGE2.replace("0 1", "1 2", 1)))
    np.testing.assert_allclose(found.poses[2], found.motions[0] @ found.motions[1])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["VERTEX_XY 0 1 2"], r"g2o:1: expected VERTEX or EDGE of SE2.*found VERTEX_XY"),
        ([EDGE2, "EDGE_SE3:QUAT 0 1 2"], r"g2o:2: expected poses of 2 dimensions"),
        ([EDGE2 + " 1"], r"g2o:1: EDGE_SE2: expected 11 numbers, found 12"),
        ([EDGE2.replace("1 0 0.1", "1 nan 0.1")], r"g2o:1: EDGE_SE2: expected finite numbers"),
        ([EDGE2.replace("1 0 0.1", "1 x 0.1")], r"g2o:1: could not convert"),
        ([EDGE2.replace("0 1", "1 1", 1)], r"g2o:1: expected an edge between two vertices, found 1 twice"),
        ([EDGE2.replace("0 1", "-1 1", 1)], r"g2o:1: expected the number of a vertex, found '-1'"),
        ([EDGE2.replace("16", "0")], r"g2o:1: edge 0 1: expected a positive definite information matrix"),
        (["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 0 1 0 0"], r"g2o:2: expected every vertex once, found 0 again"),
        (["VERTEX_SE2 0 0 0 0", EDGE2], r"g2o:2: expected an edge between vertices of the file, found no vertex 1"),
        (["VERTEX_SE2 0 0 0 0"], r"expected edges .* found none"),
    ],
)
def test_bad_lines_are_refused_by_number(tmp_path, lines, message):
    with pytest.raises(ValueError, match=message):
        read_graph(saved(tmp_path, *lines))


def test_no_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(ValueError, match="found no such file"):
        read_graph(tmp_path / "none.g2o")
    with pytest.raises(ValueError, match="found a folder"):
        read_graph(tmp_path)


def test_a_fixed_vertex_stays_and_is_written_again(tmp_path):
    vertices = ["VERTEX_SE2 0 5 5 1", "VERTEX_SE2 1 2 1 0.3"]
    found = read_graph(saved(tmp_path, *vertices, "FIX 1", EDGE2))
    assert found.anchors.tolist() == [1]
    result = optimize(found).poses
    np.testing.assert_allclose(result[1], found.poses[1], atol=1e-9)
    np.testing.assert_allclose(result[0] @ found.motions[0], found.poses[1], atol=1e-6)
    write_g2o(tmp_path / "again.g2o", found)
    assert read_graph(tmp_path / "again.g2o").fixed == (1,)
    assert read_graph(saved(tmp_path, *vertices, EDGE2)).anchors.tolist() == [0]


@pytest.mark.parametrize(
    ("names", "message"), [("0 1", "FIX: expected one vertex .* found 0 and 1"), ("7", "FIX: .* 7")]
)
def test_fixed_vertices_that_cannot_all_stay_are_refused(tmp_path, names, message):
    with pytest.raises(ValueError, match=message):
        optimize(read_graph(saved(tmp_path, "VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 1 0 0.1", f"FIX {names}", EDGE2)))
