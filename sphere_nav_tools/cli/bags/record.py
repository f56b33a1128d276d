"""`sphere_nav record`: topics into a bag."""

from __future__ import annotations

import argparse

from sphere_nav.ros.bags.recorder_node import BagRecorder
from sphere_nav.ros.bags.recording_sets import ALL, SETS
from sphere_nav.ros.run import run as run_node

HELP = """\
Record topics into a rosbag2 MCAP bag until Ctrl-C. At most the last second is lost if the process is killed.
Where BAG exists, BAG_2, BAG_3, ... is made.

  --set raw           images, camera_info, laser, IMU, odometry, tf
  --set spheres       augmented spheres, key-sphere graph
  --set localisation  poses, odometry, status, diagnostics, tf
  --set control       path, command, tracking error, follower status

examples:
  sphere_nav record -o drive --set raw
  sphere_nav record -o run1 /pose /status /cmd_vel
  sphere_nav record -o everything --all
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="topics to record")
    parser.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to make (a folder)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--set", choices=tuple(SETS), default="", dest="topic_set", help="record a set of topics")
    which.add_argument("--all", action="store_const", const=ALL, dest="topic_set", help="record every topic")
    parser.add_argument("--uncompressed", action="store_true", help="do not compress: for raw images of noisy cameras")
    parser.add_argument("--use-sim-time", action="store_true", help="stamp the messages by /clock")


def run(arguments: argparse.Namespace) -> int:
    """Record until a signal."""
    values = {
        "output": arguments.output,
        "topics": " ".join(arguments.topics),
        "topic_set": arguments.topic_set,
        "compressed": not arguments.uncompressed,
        "use_sim_time": arguments.use_sim_time,
    }
    return run_node(BagRecorder, [], values=values)
