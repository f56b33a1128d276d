"""A map is moved to the true poses of its bag."""

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.offline.mapping.truth import move_to_truth, transform_graph, truth_of
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from worlds.recordings import pose, stamp, stereo, truth, truth_of_base, write_bag


def test_the_map_moves_to_the_truth_where_that_is_known(tmp_path):
    write_bag(tmp_path / "camera", truth, numbers=range(3))
    known = truth_of(tmp_path / "camera")
    assert not known.is_base
    nodes = [KeySphere(0, stamp(1), SE3.identity()), KeySphere(1, stamp(99), SE3.identity())]
    moved = {node.id: node.T_map_sphere for node in move_to_truth(SphereGraph(nodes, []), known, SE3.identity())}
    np.testing.assert_allclose(moved[0].matrix, pose(1).matrix, atol=1e-9)
    np.testing.assert_allclose(moved[1].matrix, np.eye(4))
    turned = transform_graph(SphereGraph(nodes, []), pose(2))
    assert all(np.allclose(node.T_map_sphere.matrix, pose(2).matrix) for node in turned)


def test_the_truth_of_the_vehicle_is_known_as_such_and_none_as_none(tmp_path):
    write_bag(tmp_path / "base", truth_of_base, numbers=range(2))
    write_bag(tmp_path / "none", stereo, numbers=range(1))
    assert truth_of(tmp_path / "base").is_base
    assert truth_of(tmp_path / "none") is None
