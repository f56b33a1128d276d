"""Sets of topics by type."""

import pytest

from sphere_nav.ros.bags.recording_sets import SETS, belongs
from sphere_nav.ros.interfaces import message_class


@pytest.mark.parametrize("kind", sorted(set().union(*SETS.values()) - {"ackermann_msgs/msg/AckermannDriveStamped"}))
def test_every_type_of_a_set_exists(kind):
    assert message_class(kind)


@pytest.mark.parametrize(
    ("topic", "kind", "chosen", "expected"),
    [
        ("/image_raw", "sensor_msgs/msg/Image", "raw", True),
        ("/image_raw", "sensor_msgs/msg/Image", "control", False),
        ("/status", "sphere_nav_msgs/msg/LocalizationStatus", "localisation", True),
        ("/tf_static", "tf2_msgs/msg/TFMessage", "spheres", True),  # no recording is of use without it
        ("/anything", "std_msgs/msg/String", "all", True),
        ("/_hidden/topic", "std_msgs/msg/String", "all", False),
        ("/image_raw", "sensor_msgs/msg/Image", "", False),
    ],
)
def test_what_belongs_to_a_set(topic, kind, chosen, expected):
    assert belongs(topic, kind, chosen) is expected
