import pytest

from sphere_mapping.ros.saving import path_below


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "out").symlink_to(tmp_path)
    with pytest.raises(ValueError, match="expected a folder below"):
        path_below(tmp_path / "maps", "out/x", "a folder")
