"""Types by name; definitions and hashes agree with an independent type system."""

import pytest
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool

from sphere_nav.ros.interfaces import from_bytes, message_class, schema_text, type_hash

STANDARD = ["sensor_msgs/msg/Image", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"]
OURS = ["AugmentedSphere", "KeySphereGraph", "LocalizationStatus", "MapInfo", "ReferenceTrajectory", "FollowerStatus"]


def test_a_schema_defines_the_type_that_the_hash_names():
    for name in [*STANDARD, *(f"sphere_nav_msgs/msg/{word}" for word in OURS)]:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema_text(name), name))
        assert store.hash_rihs01(name) == type_hash(name)


def test_bytes_are_a_message_or_refused():
    assert from_bytes(serialize_message(Bool(data=True)), Bool) == Bool(data=True)
    with pytest.raises(ValueError, match="expected sensor_msgs/msg/PointCloud2, found 3 bytes that are none"):
        from_bytes(b"abc", PointCloud2)
    message = serialize_message(Bool(data=True))
    assert from_bytes(message, Bool, max_bytes=len(message)).data
    with pytest.raises(ValueError, match=f"expected at most {len(message) - 1} bytes, found {len(message)}"):
        from_bytes(message, Bool, max_bytes=len(message) - 1)


def test_a_type_that_is_not_installed_and_what_is_no_name():
    for name in ["no_msgs/msg/Thing", "std_msgs/msg/Thing"]:
        with pytest.raises(ValueError, match=f"{name}: message type is not installed here"):
            message_class(name)
        with pytest.raises(ValueError, match=f"{name}: definition not found"):
            schema_text(name)
        assert type_hash(name) == ""
    for name in ["sensor_msgs/Image", "../../etc/passwd/x"]:
        with pytest.raises(ValueError, match="message type: expected package/msg/Type"):
            message_class(name)
