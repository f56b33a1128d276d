"""`sphere_nav map-verify`: read every sphere of a map; salvage a damaged one."""

from __future__ import annotations

import argparse
from pathlib import Path

from sphere_nav.ros.maps.check import salvage_map, verify_map
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.offline.settings import add
from sphere_nav_tools.offline.tables import progress

HELP = """\
Read every key sphere of a map and check it. Exit status 1 where something is wrong, each problem on a line.

examples:
  sphere_nav map-verify kitchen_map
  sphere_nav map-verify torn_map --salvage mended_map
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "a map (a folder)", Path)
    add(parser, "--salvage", "OUT", "make a map of what is still readable", Path)


def run(arguments: argparse.Namespace) -> int:
    """Check, or salvage."""
    if arguments.salvage:
        with progress("salvage", "message") as bar:
            kept = salvage_map(arguments.map, arguments.salvage, bar.update)
        print(f"{arguments.salvage}: {kept} key spheres saved")
        return 0
    with open_map(arguments.map) as reader:
        number = len(reader.graph)
    with progress("verify", "sphere", total=number) as bar:
        problems = verify_map(arguments.map, bar.update)
    for problem in problems:
        print(problem)
    print(f"{arguments.map}: {number} key spheres, {len(problems)} problems")
    return 1 if problems else 0
