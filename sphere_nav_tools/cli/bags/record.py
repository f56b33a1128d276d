"""`sphere_nav record`: topics into a bag."""

from __future__ import annotations

import argparse

from sphere_nav.ros.bags.recorder_node import SETS, BagRecorder
from sphere_nav.ros.run import run as run_node
from sphere_nav_tools.offline.settings import add, choose, flag

HELP = """\
Record topics into a rosbag2 MCAP bag until Ctrl-C. At most the last second is lost if the process is killed.
Where BAG exists, BAG_2, BAG_3, ... is made.

  --set raw   images, camera_info, laser, IMU, odometry, tf
  --set all   every topic

examples:
  sphere_nav record -o drive --set raw
  sphere_nav record -o run1 /pose /status /cmd_vel
  sphere_nav record -o everything --set all
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "topics", "TOPIC", "topics to record", nargs="*")
    parser.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to make (a folder)")
    choose(parser, "--set", SETS, "record a set of topics", "", dest="topic_set")
    flag(parser, "--uncompressed", "do not compress: for raw images of noisy cameras")
    flag(parser, "--use-sim-time", "stamp the messages by /clock")


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
