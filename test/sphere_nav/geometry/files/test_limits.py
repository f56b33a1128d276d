"""What is larger than its limit is refused before it is read or allocated; what just fits is not."""

import pytest

pytest.importorskip("rclpy")

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.ros.conversions import camera_to_sphere_info, sphere_info_to_camera
from sphere_nav_tools.offline.importing.recording import read_image


@pytest.mark.parametrize(("kind", "read"), [("image file", read_image)])
def test_a_file_beyond_its_limit_is_not_read(tmp_path, kind, read):
    path = tmp_path / "sparse.png"
    with path.open("wb") as file:
        file.truncate(LIMITS[kind] + 1)  # takes no room on the disk
    with pytest.raises(ValueError, match=f"of at most {LIMITS[kind]} bytes, found {LIMITS[kind] + 1}"):
        read(path)


def test_a_sphere_of_8192_columns_is_the_largest():
    largest, larger = (camera_to_sphere_info(Spherical(2 * rows, rows), "sphere") for rows in (4096, 4097))
    assert sphere_info_to_camera(largest).width == 8192
    with pytest.raises(ValueError, match=r"info\.width, height: expected up to"):
        sphere_info_to_camera(larger)
