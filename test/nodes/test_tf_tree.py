"""The tree of frames of each composition: whole, one root, one parent each; with odometry on /tf, and without."""

from collections import defaultdict

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from dense_localizer.ros.node import DenseLocalizerNode
from mcl_depth.ros.node import MclDepthNode
from path_follower.ros.guard_node import CommandGuard
from path_follower.ros.node import PathFollowerNode
from sphere_mapping.ros.node import SphereMapper
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.compositions import COMPOSITIONS
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    camera_to_sphere_info,
    se3_to_odometry,
    se3_to_pose_with_covariance,
    se3_to_transform,
)
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, drive, picture, wide_map
from worlds.mcl import SETTINGS, T_BASE_EYE, T_ODOM_MAP, Eye, room_points
from worlds.mcl import drive as around_the_room
from worlds.recordings import mount, sphere

START_NS, OPTICAL = 1_000_000_000, "camera_optical"
NODES = {"dense_localizer": DenseLocalizerNode, "path_follower": PathFollowerNode, "command_guard": CommandGuard}
NODES |= {"sphere_mapper": SphereMapper, "mcl_depth": MclDepthNode}
SMALL = {"dense_localizer": SMALL_IMAGES, "mcl_depth": SETTINGS}


def start(name, namespace="", **given):
    """Return a bus with those nodes of a composition that need no process of their own."""
    composition = COMPOSITIONS[name]
    given |= {"namespace": namespace}
    bus = OfflineBus()
    for item in composition.starts({key: value for key, value in given.items() if key in composition.arguments}):
        if item.node in NODES:
            values = {key: value for key, value in item.parameters.items() if key != "use_sim_time"}
            bus.add(NODES[item.node], values | SMALL.get(item.node, {}), item.topics)
    return bus


def send(bus, topic, message):
    bus.publish(topic, message)
    return list(bus.settle())


def edges(said):
    parents = defaultdict(set)
    for item in said:
        for transform in item.message.transforms if item.topic in ("/tf", "/tf_static") else ():
            parents[transform.child_frame_id].add(transform.header.frame_id)
    return dict(parents)


def check(parents, root, *leaves):
    assert {child: found for child, found in parents.items() if len(found) != 1} == {}
    assert set().union(*parents.values()) - parents.keys() == {root}
    for frame in leaves:
        while frame != root:
            (frame,) = parents[frame]


@pytest.fixture(scope="module")
def map_path(tmp_path_factory):
    return str(save_map(tmp_path_factory.mktemp("maps") / "room", wide_map(-2.0, -1.0, 0.0, 1.0).graph))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "has_odometry"), [("localisation", False), ("simulation", True)])
def test_a_camera_in_a_map(map_path, name, has_odometry):
    bus = start(name, map=map_path, bag="drive", guard="true")
    camera = se3_to_transform(T_BODY_OPTICAL, START_NS, "base_link", OPTICAL)
    said = send(bus, "/tf_static", TFMessage(transforms=[camera]))
    for k, pose in enumerate(drive(8)):
        now = START_NS + (k + 1) * STEP_NS
        said += bus.advance(now)
        if has_odometry:
            T_odom_base = pose @ T_BODY_OPTICAL.inverse()
            said += send(bus, "/odom", se3_to_odometry(T_odom_base, np.eye(6), now, ("odom", "base_link"), np.zeros(6)))
            moved = se3_to_transform(T_odom_base, now, "odom", "base_link")
            said += send(bus, "/tf", TFMessage(transforms=[moved]))
        said += send(bus, "/camera_info", camera_to_info(PINHOLE, now, OPTICAL))
        said += send(bus, "/image_raw", array_to_image(picture(k), now, OPTICAL, "mono8"))
    check(edges(said), "map", OPTICAL, *(["odom"] if has_odometry else []))


@pytest.mark.slow
def test_a_camera_in_bare_geometry(tmp_path):
    np.save(tmp_path / "room.npy", room_points())
    eye = Eye()
    bus = start("mcl", cloud=str(tmp_path / "room.npy"))
    said = send(bus, "/tf_static", TFMessage(transforms=[se3_to_transform(T_BASE_EYE, START_NS, "base_link", "eye")]))
    said += send(bus, "/sphere_info", camera_to_sphere_info(eye.camera, "eye"))
    start_pose = se3_to_pose_with_covariance(around_the_room(1)[0], 0.01 * np.eye(6), START_NS, "map")
    said += send(bus, "/initialpose", start_pose)
    for k, T_map_base in enumerate(around_the_room(12)):
        now = START_NS + (k + 1) * 10**9
        said += bus.advance(now)
        T_odom_base = T_ODOM_MAP @ T_map_base
        said += send(bus, "/odom", se3_to_odometry(T_odom_base, 1e-4 * np.eye(6), now, ("odom", "base_link")))
        moved = se3_to_transform(T_odom_base, now, "odom", "base_link")
        said += send(bus, "/tf", TFMessage(transforms=[moved]))
        said += send(bus, "/image_raw", array_to_image(eye.picture(T_map_base), now, "eye", "mono8"))
    check(edges(said), "map", "eye", "odom")


def test_a_map_in_the_making():
    bus, said = start("mapping"), []
    for topic, message in [("tf_static", mount()), *(pair for number in range(4) for pair in sphere(number))]:
        said += send(bus, f"/{topic}", message)
    check(edges(said), "map", "sphere_link", "base_link")
