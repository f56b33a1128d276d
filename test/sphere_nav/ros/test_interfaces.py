"""Types by name; definitions and hashes agree with those of rosidl."""

import json

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool

from sphere_nav.ros import interfaces
from sphere_nav.ros.interfaces import from_bytes, message_class, schema_text, type_hash

STANDARD = ["sensor_msgs/msg/Image", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"]
OURS = ["AugmentedSphere", "KeySphereGraph", "LocalizationStatus", "MapInfo", "ReferenceTrajectory", "FollowerStatus"]


def test_the_hash_of_a_type_is_that_of_rosidl():
    for name in [*STANDARD, *(f"sphere_nav_msgs/msg/{word}" for word in OURS)]:
        package, folder, kind = name.split("/")
        told = interfaces._share(package, f"{folder}/{kind}.json")  # as rosidl has written it
        hashes = json.loads(told.read_text())["type_hashes"]
        assert type_hash(name) == next(entry["hash_string"] for entry in hashes if entry["type_name"] == name)


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
        for find in (message_class, schema_text):
            with pytest.raises(ValueError, match=f"{name}: message type is not installed here: no share/"):
                find(name)
        assert type_hash(name) == ""
    for name in ["sensor_msgs/Image", "../../etc/passwd/x"]:
        with pytest.raises(ValueError, match="message type: expected package/msg/Type"):
            message_class(name)
