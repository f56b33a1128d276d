"""`sphere_nav verify-bag`: is a bag whole, what is in it, and what can be saved of it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sphere_nav.ros.bags import salvage, verify_bag
from sphere_nav_tools.cli.arguments import add
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
    with progress("verify", "message") as bar:
        report = verify_bag(arguments.bag, bar.update)
    seconds = (report.time_range[1] - report.time_range[0]) / 1e9
    topics = sorted(report.topics.items())
    verdict = "damaged" if report.problems else "good"
    head = f"{report.path}: {verdict}, {report.num_messages} messages in {seconds:.1f} s"
    print("\n".join([head, *columns((f"  {name}", info.count, info.type) for name, info in topics)]))
    for problem in report.problems:
        print(problem, file=sys.stderr)
    return 1 if report.problems else 0
