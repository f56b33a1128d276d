import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_mapping.params import MapperParams
from sphere_mapping.ros.saving import details_of
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import KeySphere, SphereGraph


def test_the_map_id_changes_with_poses_and_only_then():
    def graph(x):
        return SphereGraph([KeySphere(0, 5, SE3.from_parts(np.eye(3), [x, 0, 0]))])

    first, same, other = (details_of(graph(x), MapperParams()).map_id for x in (1.0, 1.0, 1.1))
    assert first == same != other
    assert details_of(graph(1.0), MapperParams()).parameters["key.max_mad_share"] == 0.05
