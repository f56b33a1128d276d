"""`sphere_nav mcl`: a recorded camera in a point cloud, through the very callbacks of the node."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from mcl_depth.ros.node import MclDepthNode
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav_tools.cli.constants import MAX_LEAP_S
from sphere_nav_tools.offline import localizing, topics
from sphere_nav_tools.offline.settings import add

HELP = """\
Find the camera of a bag in bare geometry. It needs no start; in a map of one or two rooms give --initial-pose, because
there a right place is hard to tell from a chance match. CLOUD is .ply, .pcd, .las, .laz, .npy, .e57, a floor plan .csv,
a folder of tiles, or a map made by `sphere_nav map`. The poses of base_link in the states TRACKING and DEGRADED are
written as a TUM file.

examples:
  sphere_nav mcl town.ply drive -o poses.tum
  sphere_nav mcl room.ply drive -o poses.tum --initial-pose 1.0,2.5,0,0,0,0,1
  sphere_nav mcl tile.laz drive --set preset=outdoor -o poses.tum
  sphere_nav mcl utm_tile.laz drive --set survey.origin=500200,5412300,0 -o poses.tum
  sphere_nav mcl campus drive2 -o poses.tum --bag result --set resampling.num_particles=2000
"""
TOPICS = ("/pose", "/fix", "/status", "/tf", "/particle_cloud", "/heading")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "cloud", "CLOUD", "geometry to localise in")
    add(parser, "source", "BAG", "bag with images, camera_info or sphere_info, and odometry")
    localizing.add_arguments(parser, "mcl_depth")


def run(arguments: argparse.Namespace) -> int:
    """Localise every image; 1 if none could be localised."""
    return localizing.write_poses(arguments, replayed(arguments))


def replayed(arguments: argparse.Namespace) -> Iterator[Recorded]:
    """Yield what the node publishes."""
    if cameras := topics.camera_names(arguments.topics):
        raise ValueError(f"--camera: expected one camera (--image TOPIC), found {', '.join(cameras)}")

    values = {
        "cloud": arguments.cloud,
        "input.max_leap_s": MAX_LEAP_S,
        "every_image": True,
    }
    return localizing.replay_localizer(arguments, TOPICS, MclDepthNode, values)
