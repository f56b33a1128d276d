"""The node path_follower on an offline bus, 50 m of straight road, and a vehicle that does what it is told."""

import numpy as np

from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import poses_to_path, se3_to_pose_with_covariance, status_to_message

SECOND = 1_000_000_000


def follower_bus(**values):
    bus = OfflineBus()
    node = bus.add(PathFollowerNode, {"enable_stamped_cmd_vel": True} | values)
    points = [(0, SE3.from_planar(x, 0, 0)) for x in np.arange(0, 50, 0.5)]
    list(bus.advance(SECOND))
    bus.deliver("/reference_path", poses_to_path(points, SECOND, "map"))
    return bus, node


def pose(bus, x, stamp, y=0.0, frame="map"):
    bus.deliver("/pose", se3_to_pose_with_covariance(SE3.from_planar(x, y, 0), 1e-4 * np.eye(6), stamp, frame))


def status(bus, state, stamp, reason="", age=0.0, milliseconds=0.0):
    told = Status(State(state), reason, age=age, milliseconds=milliseconds)
    bus.deliver("/status", status_to_message(told, stamp, "map"))


def speeds(said):
    return [item.message.twist.linear.x for item in said if item.topic == "/cmd_vel"]


def last(said, topic):
    """Return the last message of a topic."""
    return [item.message for item in said if item.topic == topic][-1]


def drive(bus, node, images, x=0.0, y=0.0):
    """Drive at full speed on good poses; return where the vehicle is."""
    for k in range(images):
        list(bus.advance(bus.now_ns + SECOND // 10))
        status(bus, "TRACKING", bus.now_ns)
        pose(bus, x, bus.now_ns, y)
        commands = speeds(bus.settle())
        x += 0.1 * commands[-1]
        if k == 2:
            assert node.endpoints.call("start").success
    return x
