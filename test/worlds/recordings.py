"""A short drive through the room of `worlds.py` as ROS messages and as a bag, with its truth."""

from __future__ import annotations

import numpy as np
from tf2_msgs.msg import TFMessage

from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    se3_to_odometry,
    se3_to_pose_stamped,
    se3_to_transform,
    sphere_to_message,
)
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import optical, sharp_room

CAMERA = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
BASELINE = 0.5
ROOM = sharp_room()
STEP = SE3.exp([0.05, 0.01, 0.0, 0.0, 0.005, 0.02])
FIRST = SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])
T_BASE_CAMERA = SE3.from_parts(np.eye(3), [0.4, 0.0, 1.1])
FRAME = "camera_optical"
START_NS, PERIOD_NS = 1_000_000_000, 100_000_000


def pose(number):
    """Return T_map_camera (body axes) of a frame."""
    return FIRST @ SE3.exp(STEP.log() * number)


def stamp(number):
    return START_NS + number * PERIOD_NS


def mount(sphere_frame="sphere_link"):
    camera = se3_to_transform(T_BASE_CAMERA, START_NS, "base_link", "camera_link")
    lens = se3_to_transform(T_BODY_OPTICAL, START_NS, "camera_link", FRAME)
    sphere = se3_to_transform(T_BASE_CAMERA, START_NS, "base_link", sphere_frame)
    return TFMessage(transforms=[camera, lens, sphere])


def rgbd(number, T_room_camera=None):
    """Yield topic and message of one instant of an RGB-D camera, at its pose of the drive or at another one."""
    image, depth_m = ROOM.rgbd(CAMERA, optical(T_room_camera or pose(number)))
    yield "camera_info", camera_to_info(CAMERA, stamp(number), FRAME)
    yield "depth/image_raw", array_to_image(depth_m, stamp(number), FRAME, "32FC1")
    yield "image_raw", array_to_image(image, stamp(number), FRAME, "mono8")


def stereo(number):
    """Yield topic and message of one instant of a rectified pair."""
    left, _ = ROOM.rgbd(CAMERA, optical(pose(number)))
    right, _ = ROOM.rgbd(CAMERA, optical(pose(number)) @ SE3.from_parts(np.eye(3), [BASELINE, 0, 0]))
    yield "left/camera_info", camera_to_info(CAMERA, stamp(number), FRAME)
    yield "right/camera_info", camera_to_info(CAMERA, stamp(number), FRAME, baseline=BASELINE)
    yield "left/image_raw", array_to_image(left, stamp(number), FRAME, "mono8")
    yield "right/image_raw", array_to_image(right, stamp(number), FRAME, "mono8")


def sphere(number):
    """Yield topic and message of one instant of a camera that gives spheres."""
    image, depth_m = ROOM.rgbd(CAMERA, optical(pose(number)))
    yield "sphere", sphere_to_message(sphere_from_rgbd(image, depth_m, CAMERA, stamp_ns=stamp(number)), "sphere_link")


def truth(number):
    yield "ground_truth/pose", se3_to_pose_stamped(pose(number), stamp(number), "map")


def truth_of_base(number):
    T_map_base = pose(number) @ T_BASE_CAMERA.inverse()
    yield "ground_truth/odometry", se3_to_odometry(T_map_base, np.zeros((6, 6)), stamp(number), ("world", "base_link"))


def write_bag(path, *sources, numbers=range(8), with_mount=True):
    """Write a bag of the instants that the sources yield."""
    with BagWriter(path) as bag:
        if with_mount:
            bag.add_topic("/tf_static", TFMessage, qos.LATCHED)
            bag.write("/tf_static", mount(), START_NS)
        for number in numbers:
            for source in sources:
                for topic, message in source(number):
                    bag.add_topic(topic, type(message), qos.STATE)
                    bag.write(topic, message, stamp(number))
    return path
