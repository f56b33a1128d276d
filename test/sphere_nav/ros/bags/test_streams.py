"""Topics are told apart by type, encoding and name."""

from __future__ import annotations

import pytest

from sphere_nav.ros.bags.streams import Stream
from worlds.streams import compressed, image


@pytest.mark.parametrize(
    ("stream", "is_depth", "is_picture", "base"),
    [
        (image("/front/image_raw"), False, True, "/front/image_raw"),
        (image("/depth/image_raw", "16UC1"), True, False, "/depth/image_raw"),
        (compressed("/d/image_raw/compressedDepth", "16UC1; compressedDepth png"), True, False, "/d/image_raw"),
        (Stream("/odom/compressed", "nav_msgs/msg/Odometry", 9, 5.0), False, False, "/odom"),
    ],
)
def test_depth_pictures_and_transports_are_told_apart(stream, is_depth, is_picture, base):
    assert (stream.is_depth, stream.is_picture, stream.base) == (is_depth, is_picture, base)
