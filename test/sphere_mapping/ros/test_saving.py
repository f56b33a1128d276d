import pytest

pytest.importorskip("rclpy")

from sphere_mapping.ros.saving import path_below


def test_a_path_below_the_folder_is_allowed(tmp_path):
    assert path_below(tmp_path, "town/north", "a folder") == tmp_path / "town/north"
    assert path_below(tmp_path, str(tmp_path / "town"), "a folder") == tmp_path / "town"


def test_a_path_elsewhere_is_refused(tmp_path):
    for name in ["a/../..", "../x"]:
        with pytest.raises(ValueError, match="expected a folder below"):
            path_below(tmp_path, name, "a folder")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "out").symlink_to(tmp_path)
    with pytest.raises(ValueError, match="expected a folder below"):
        path_below(tmp_path / "maps", "out/x", "a folder")
