import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_geometry import SE3
from sphere_map.graph import KeySphere, SphereGraph
from sphere_mapping.params import MapperParams
from sphere_mapping.saving_node import details_of, path_below


def test_a_path_below_the_folder_is_allowed(tmp_path):
    assert path_below(tmp_path, "town/north") == tmp_path / "town/north"
    assert path_below(tmp_path, str(tmp_path / "town")) == tmp_path / "town"


@pytest.mark.parametrize("name", ["", ".", "..", "a/../..", "../x", "/etc/x"])
def test_a_path_elsewhere_is_refused(name, tmp_path):
    with pytest.raises(ValueError, match="expected a folder below"):
        path_below(tmp_path, name)


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "out").symlink_to(tmp_path)
    with pytest.raises(ValueError, match="expected a folder below"):
        path_below(tmp_path / "maps", "out/x")


def test_the_map_id_changes_with_poses_and_only_then():
    def graph(x):
        return SphereGraph([KeySphere(0, 5, SE3.from_parts(np.eye(3), [x, 0, 0]))])

    first, same, other = (details_of(graph(x), MapperParams()).map_id for x in (1.0, 1.0, 1.1))
    assert first == same != other
    assert details_of(graph(1.0), MapperParams()).parameters["key.max_mad_share"] == 0.05
