"""A recording with few images is localised, too."""

import pytest

pytest.importorskip("rclpy")

from sphere_nav.offline.recorded_camera import patience
from sphere_nav.ros.bags.streams import Stream

IMAGE = "sensor_msgs/msg/Image"


@pytest.mark.parametrize(("rate_hz", "timeout_s"), [(1.0, 4.0), (2.0, 2.0), (30.0, None), (8.0, None)])
def test_the_time_out_is_that_of_several_images(rate_hz, timeout_s, caplog):
    streams = [Stream("/image", IMAGE, 20, rate_hz), Stream("/other", IMAGE, 20, 0.1)]
    assert patience(streams, ["/image"]) == ({"input.timeout_s": timeout_s} if timeout_s else {})
    assert ("input.timeout_s" in caplog.text) == bool(timeout_s)


def test_a_single_image_tells_no_rate():
    assert patience([Stream("/image", IMAGE, 1, 0.0)], ["/image"]) == {}
