"""`sphere_nav verify-bag`: is a bag whole, what is in it, and what can be saved of it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from sphere_nav.ros.bags import BagReport, salvage, verify_bag
from sphere_nav_tools.offline.tables import columns, progress

HELP = """\
Read every message of a bag, check its checksums, and tell what is in it. Exit status 1 if there is a problem.

examples:
  sphere_nav verify-bag drive
  sphere_nav verify-bag drive --json
  sphere_nav verify-bag drive.partial --salvage drive     # what is readable of a bag that was cut off
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="a folder or an .mcap file")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument("--salvage", type=Path, metavar="OUT", help="copy what is readable into a new bag")


def run(arguments: argparse.Namespace) -> int:
    """Check, or salvage."""
    if arguments.salvage:
        with progress("salvage", "message") as bar:
            count = salvage(arguments.bag, arguments.salvage, bar.update)
        print(f"{arguments.salvage}: {count} messages salvaged")
        return 0
    with progress("verify", "message") as bar:
        report = verify_bag(arguments.bag, bar.update)
    print(json.dumps(_as_dict(report), indent=2) if arguments.json else _as_text(report))
    for problem in report.problems:
        print(problem, file=sys.stderr)
    return 1 if report.problems else 0


def _as_dict(report: BagReport) -> dict[str, object]:
    return {
        "bag": str(report.path),
        "messages": report.num_messages,
        "seconds": (report.time_range[1] - report.time_range[0]) / 1e9,
        "topics": {name: {"type": info.type, "count": info.count} for name, info in sorted(report.topics.items())},
        "problems": report.problems,
    }


def _as_text(report: BagReport) -> str:
    seconds = (report.time_range[1] - report.time_range[0]) / 1e9
    verdict = "good" if not report.problems else "damaged"
    lines = [f"{report.path}: {verdict}, {report.num_messages} messages in {seconds:.1f} s"]
    topics = ((f"  {name}", info.count, info.type) for name, info in sorted(report.topics.items()))
    return "\n".join([*lines, *columns(topics)])
