"""A recording with few images is localised, too."""

from sphere_nav.ros.bags.streams import Stream
from sphere_nav_tools.offline.recorded_camera import patience

IMAGE = "sensor_msgs/msg/Image"


def test_the_time_out_is_that_of_several_images(caplog):
    for rate_hz, timeout_s in [(1.0, 4.0), (2.0, 2.0), (30.0, None), (8.0, None)]:
        streams = [Stream("/image", IMAGE, 20, rate_hz), Stream("/other", IMAGE, 20, 0.1)]
        assert patience(streams, ["/image"]) == ({"input.timeout_s": timeout_s} if timeout_s else {})
        assert ("input.timeout_s" in caplog.text) == bool(timeout_s)
        caplog.clear()


def test_the_slowest_of_several_cameras_counts():
    streams = [Stream("/a", IMAGE, 20, 10.0), Stream("/b", IMAGE, 20, 1.0), Stream("/c", IMAGE, 1, 0.1)]
    assert patience(streams, ["/a", "/b", "/c"]) == {"input.timeout_s": 4.0}
    assert patience([Stream("/a", IMAGE, 20, 0.0), streams[0]], ["/a"]) == {}
