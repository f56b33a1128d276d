"""The steps of `map` that need no bag: where the map lies, what it says of itself, what is missing."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav.geometry import SE3
from sphere_nav.offline.mapping import learning
from sphere_nav.offline.mapping.learning import anchor_map, rig_text, start_of
from sphere_nav.offline.mapping.replay_mapper import stitcher_values
from sphere_nav.offline.mapping.truth import Truth
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import KeySphere, SphereGraph

T_FITTED = SE3.from_planar(1.0, 2.0, 0.5)


def drive(T_fitted=T_FITTED):
    graph = SphereGraph([KeySphere(k, k, SE3.from_planar(float(k), 0.0, 0.0)) for k in range(3)])
    mapper = SimpleNamespace(graph=graph)
    node = SimpleNamespace(mapper=mapper, T_base_sphere=SE3.identity())
    return SimpleNamespace(node=node, fit=lambda truth: T_fitted)


def arguments(**values):
    return SimpleNamespace(**({"anchor": "truth", "bag": Path("here/drive"), "rig": None} | values))


def test_a_map_begins_at_its_first_sphere_or_lies_on_the_truth(monkeypatch):
    truth = Truth(None, is_base=False)
    T, graph, warnings = anchor_map(arguments(anchor="first"), drive(), truth)
    assert (T.matrix.tolist(), warnings) == (np.eye(4).tolist(), [])
    assert graph[2].T_map_sphere.translation[0] == 2.0
    T, graph, warnings = anchor_map(arguments(), drive(), truth)
    assert T is T_FITTED
    np.testing.assert_allclose(graph[2].T_map_sphere.matrix, (T_FITTED @ SE3.from_planar(2.0, 0.0, 0.0)).matrix)
    monkeypatch.setattr(learning, "move_to_truth", lambda graph, truth, T: graph.with_poses({0: SE3.identity()}))
    monkeypatch.setattr(learning, "check_survey", lambda aligned, surveyed, source: [source])
    T, graph, warnings = anchor_map(arguments(anchor="survey"), drive(), truth)
    assert warnings == ["here/drive"]
    np.testing.assert_array_equal(graph[0].T_map_sphere.matrix, np.eye(4))
    with pytest.raises(BagError, match="expected poses at the stamps of the spheres, found none"):
        anchor_map(arguments(), drive(None), truth)
    with pytest.raises(BagError, match="here/drive: ground_truth/pose or ground_truth/odometry: expected poses"):
        anchor_map(arguments(), drive(), None)


def test_a_map_names_its_bag_and_keeps_its_rig(tmp_path):
    (tmp_path / "rig.yaml").write_text("name: ring\n")
    begun = start_of(arguments(rig=tmp_path / "rig.yaml"))
    assert (begun.source, begun.rig) == ("drive", "name: ring\n")
    assert rig_text(arguments()) == ""


def test_cameras_need_the_file_of_their_rig():
    with pytest.raises(BagError, match="drive: expected --rig with the rig file of its cameras, found none"):
        stitcher_values(SimpleNamespace(path="drive"), {}, arguments())
