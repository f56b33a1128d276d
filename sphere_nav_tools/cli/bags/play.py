"""`sphere_nav play`: the messages of a bag, published again."""

from __future__ import annotations

import argparse

from sphere_nav.params import leaves
from sphere_nav.ros.bags.player_node import BagPlayer, PlayerParams
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.run import run as run_node
from sphere_nav_tools.offline.tables import progress

HELP = """\
Publish the messages of a bag in the order and at the pace of recording. Latched topics (tf_static) come first.

examples:
  sphere_nav play drive --clock
  sphere_nav play drive --rate 0.5 --start 12 --topics /image_raw /camera_info
  sphere_nav play drive --rate 0 --wait-for /image_raw        # as fast as the listeners take it
"""


OPTIONS = [leaf for leaf in leaves(PlayerParams) if leaf.name != "bag"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the bag, and the other parameters of the node as options."""
    parser.add_argument("bag", metavar="BAG", help="a folder or an .mcap file")
    for leaf in OPTIONS:
        option, told = f"--{leaf.name.replace('_', '-')}", leaf.doc
        if isinstance(leaf.default, bool):
            parser.add_argument(option, action="store_true", help=told)
        elif isinstance(leaf.default, str):
            parser.add_argument(option, nargs="+", default=[], metavar="TOPIC", help=told)
        else:
            parser.add_argument(option, type=float, default=leaf.default, metavar="X", help=f"{told} (%(default)g)")


def run(arguments: argparse.Namespace) -> int:
    """Play to the end, or until a signal."""
    given = {name: getattr(arguments, name) for name in ("bag", *(leaf.name for leaf in OPTIONS))}
    values = {name: " ".join(value) if isinstance(value, list) else value for name, value in given.items()}
    with progress("play", "message") as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        def prepare(node: ManagedNode) -> None:
            node.progress = show  # type: ignore[attr-defined]

        return run_node(BagPlayer, [], values=values, prepare=prepare)
