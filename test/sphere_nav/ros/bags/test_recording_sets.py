"""What belongs to a set."""

from sphere_nav.ros.bags.recording_sets import SETS, belongs
from sphere_nav.ros.interfaces import message_class


def test_every_type_of_a_set_exists_and_what_belongs_to_it():
    for kind in sorted(set().union(*SETS.values()) - {"ackermann_msgs/msg/AckermannDriveStamped"}):
        assert message_class(kind)
    for topic, kind, chosen, expected in [
        ("/image_raw", "sensor_msgs/msg/Image", "raw", True),
        ("/image_raw", "sensor_msgs/msg/Image", "control", False),
        ("/status", "sphere_nav_msgs/msg/LocalizationStatus", "localisation", True),
        ("/tf_static", "tf2_msgs/msg/TFMessage", "spheres", True),  # no recording is of use without it
        ("/anything", "std_msgs/msg/String", "all", True),
        ("/_hidden/topic", "std_msgs/msg/String", "all", False),
        ("/image_raw", "sensor_msgs/msg/Image", "", False),
    ]:
        assert belongs(topic, kind, chosen) is expected
