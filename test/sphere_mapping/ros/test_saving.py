import numpy as np
import pytest

from sphere_mapping.params import MapperParams
from sphere_mapping.ros.saving import details_of, path_below
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.maps.reader import open_map, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from worlds.localizer import make_map
from worlds.room import Room


def test_the_map_id_changes_with_poses_and_only_then():
    def graph(x):
        return SphereGraph([KeySphere(0, 5, SE3.from_parts(np.eye(3), [x, 0, 0]))])

    first, same, other = (details_of(graph(x), MapperParams()).map_id for x in (1.0, 1.0, 1.1))
    assert first == same != other
    assert details_of(graph(1.0), MapperParams()).parameters["key.max_mad_share"] == 0.05


@pytest.mark.parametrize("T_base_sphere", [None, SE3.from_angles(0.1, -0.2, 0.3, [0.6, -0.1, 1.8])])
def test_a_map_tells_where_its_spheres_were_on_the_vehicle(T_base_sphere, tmp_path):
    graph = make_map(Room(), [SE3.identity()], Spherical(64, 32)).graph
    details = details_of(graph, MapperParams(), frame=("a mark on the floor", T_base_sphere))
    with open_map(save_map(tmp_path / "map", graph, details)) as reader:
        assert reader.origin == "a mark on the floor"
        found = reader.T_base_sphere
    assert (found is None) == (T_base_sphere is None)
    assert found is None or found.distance(T_base_sphere) < (1e-5, 1e-5)


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "out").symlink_to(tmp_path)
    with pytest.raises(ValueError, match="expected a folder below"):
        path_below(tmp_path / "maps", "out/x", "a folder")
