import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.ros.node import draw_preview
from sphere_nav.geometry import Spherical
from sphere_nav.spheres.sphere import Sphere


@pytest.mark.parametrize(("width", "shown"), [(2048, 1024)])
def test_a_preview_is_a_small_jpeg_in_the_colors_of_the_sphere(width, shown):
    image = np.full((width // 2, width, 3), (200, 100, 30), np.uint8)
    sphere = Sphere(image, np.ones(image.shape[:2], np.float32), Spherical(width, width // 2), 7_000_000_005)
    message = draw_preview(sphere, "there")
    seen = cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_COLOR)
    assert seen.shape == (shown // 2, shown, 3)
    assert np.abs(seen.astype(int) - (30, 100, 200)).max() <= 4  # BGR; what JPEG loses of one colour
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (7, 5, "there")
