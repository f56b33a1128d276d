"""`sphere_nav localize`: a recorded camera in a map, through the very callbacks of the node."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav_tools.offline import localizing
from sphere_nav_tools.offline.settings import add

HELP = """\
Find the camera of a bag in a map, image by image, from colour alone. The poses of base_link in the states TRACKING and
DEGRADED are written as a TUM file: stamp x y z qx qy qz qw; their covariances beside it into a .cov file.

examples:
  sphere_nav localize kitchen drive2 -o poses.tum
  sphere_nav localize kitchen drive2 -o poses.tum --bag result --json summary.json
  sphere_nav localize campus tour -o poses.tum --image /front/image_raw --info /front/camera_info
  sphere_nav localize campus tour -o poses.tum --camera front=/front/image_raw --camera back=/back/image_raw
  sphere_nav localize campus tour -o poses.tum --set rig.calibration=map --mounting 0,0,1.4,0,0,0 \\
      --camera front=/cameras/front/image_raw --camera back=/cameras/back/image_raw
  sphere_nav localize campus walk360 -o poses.tum --set is_panorama=true --image /theta/image_raw
  sphere_nav localize campus tour -o poses.tum --initial-pose 1.0,2.5,0,0,0,0,1
"""
TOPICS = ("/pose", "/odometry", "/status", "/tf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "map made by `sphere_nav map`")
    add(parser, "source", "BAG", "bag with images and camera_info")
    localizing.add_arguments(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Localise every image; 1 if none could be localised."""
    return localizing.write_poses(arguments, replayed(arguments))


def replayed(arguments: argparse.Namespace) -> Iterator[Recorded]:
    """Yield what the node publishes."""
    return localizing.replay_localizer(arguments, TOPICS, DenseLocalizerNode, {"map": arguments.map})
