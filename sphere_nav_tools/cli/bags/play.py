"""`sphere_nav play`: the messages of a bag, published again."""

from __future__ import annotations

import argparse

from tqdm import tqdm

from sphere_nav.ros.bags.player_node import BagPlayer
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.run import run as run_node

HELP = """\
Publish the messages of a bag in the order and at the pace of recording. Latched topics (tf_static) come first.

examples:
  sphere_nav play drive --clock
  sphere_nav play drive --rate 0.5 --start 12 --topics /image_raw /camera_info
  sphere_nav play drive --rate 0 --wait-for /image_raw        # as fast as the listeners take it
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", metavar="BAG", help="a folder or an .mcap file")
    parser.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="play these only")
    parser.add_argument("--rate", type=float, default=1.0, metavar="X", help="speed; 0: as fast as acknowledged (1)")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="begin so many seconds into the bag")
    parser.add_argument("--clock", action="store_true", help="publish /clock")
    parser.add_argument("--paused", action="store_true", help="wait for a call of bag_player/resume")
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--wait-for", nargs="+", default=[], metavar="TOPIC", help="wait until these have a listener")


def run(arguments: argparse.Namespace) -> int:
    """Play to the end, or until a signal."""
    words = {name: " ".join(getattr(arguments, name)) for name in ("topics", "wait_for")}
    values = {name: getattr(arguments, name) for name in ("bag", "rate", "start", "clock", "paused", "loop")} | words
    with tqdm(unit="message", desc="play", disable=None) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        def prepare(node: ManagedNode) -> None:
            node.progress = show  # type: ignore[attr-defined]

        return run_node(BagPlayer, [], values=values, prepare=prepare)
