"""Recordings of another writer, under the names of drivers, as recorders before type hashes made them."""

from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CompressedImage

from sphere_nav.ros.bags.reader import BagReader

REALSENSE = {
    "/image_raw": "/camera/camera/color/image_raw",
    "/camera_info": "/camera/camera/color/camera_info",
    "/depth/image_raw": "/camera/camera/aligned_depth_to_color/image_raw",
    "/tf_static": "/tf_static",
}


def copy_bag(source, target, names, change=lambda topic, message: message, storage=StoragePlugin.MCAP):
    """Write a bag's messages under other names."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with BagReader(source) as bag, Writer(target, version=9, storage_plugin=storage) as writer:
        connections = {}
        for topic, stamp, message in bag.messages(names):
            changed = change(names[topic], message)
            kind = type(changed)
            name = names[topic] + {CompressedImage: "/compressed"}.get(kind, "")
            if name not in connections:
                type_name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
                connections[name] = writer.add_connection(name, type_name, typestore=store)
            writer.write(connections[name], stamp, bytes(serialize_message(changed)))
    return target
