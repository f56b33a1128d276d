"""`sphere_nav play`: the messages of a bag, published again."""

from __future__ import annotations

import argparse

from sphere_nav.params import leaves
from sphere_nav.ros.bags.player_node import BagPlayer, PlayerParams
from sphere_nav.ros.run import run as run_node
from sphere_nav_tools.offline.settings import add, flag
from sphere_nav_tools.offline.tables import progress

HELP = """\
Publish the messages of a bag in the order and at the pace of recording. Latched topics (tf_static) come first.

examples:
  sphere_nav play drive --clock
  sphere_nav play drive --rate 0.5 --start 12 --topics /image_raw /camera_info
  sphere_nav play drive --rate 0 --wait-for /image_raw        # as fast as the listeners take it
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the bag, and the other parameters of the node as options."""
    for leaf in leaves(PlayerParams):
        option, told = f"--{leaf.name.replace('_', '-')}", leaf.doc
        if leaf.name == "bag":
            add(parser, "bag", "BAG", "a folder or an .mcap file")
        elif isinstance(leaf.default, bool):
            flag(parser, option, told)
        elif isinstance(leaf.default, str):
            add(parser, option, "TOPIC", told, nargs="+", default=[])
        else:
            add(parser, option, "X", f"{told} (%(default)g)", float, default=leaf.default)


def run(arguments: argparse.Namespace) -> int:
    """Play to the end, or until a signal."""
    given = {leaf.name: getattr(arguments, leaf.name) for leaf in leaves(PlayerParams)}
    values = {name: " ".join(value) if isinstance(value, list) else value for name, value in given.items()}
    with progress("play", "message") as bar:

        class ShownPlayer(BagPlayer):
            def progress(self, done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

        return run_node(ShownPlayer, [], values=values)
