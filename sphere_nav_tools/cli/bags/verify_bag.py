"""`sphere_nav verify-bag`: is a bag whole, what is in it, and what can be saved of it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sphere_nav.ros.bags import BagReader, salvage, verify_bag
from sphere_nav_tools.offline.settings import add
from sphere_nav_tools.offline.tables import columns, progress

HELP = """\
Read every message of a bag, check its checksums, and tell what is in it. Exit status 1 if there is a problem.

examples:
  sphere_nav verify-bag drive
  sphere_nav verify-bag drive.partial --salvage drive     # what is readable of a bag that was cut off
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "bag", "BAG", "a folder or an .mcap file", Path)
    add(parser, "--salvage", "OUT", "copy what is readable into a new bag", Path)


def run(arguments: argparse.Namespace) -> int:
    """Check, or salvage."""
    if arguments.salvage:
        with progress("salvage", "message") as bar:
            count = salvage(arguments.bag, arguments.salvage, bar.update)
        print(f"{arguments.salvage}: {count} messages salvaged")
        return 0
    with BagReader(arguments.bag, is_empty_allowed=True) as bag, progress("verify", "message") as bar:
        number, problems = verify_bag(bag, bar.update)
        begin, end = bag.time_range
    topics = sorted(bag.topics.items())
    verdict = "damaged" if problems else "good"
    head = f"{bag.path}: {verdict}, {number} messages in {(end - begin) / 1e9:.1f} s"
    print("\n".join([head, *columns((f"  {name}", info.count, info.type) for name, info in topics)]))
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0
