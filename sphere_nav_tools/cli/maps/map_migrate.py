"""`sphere_nav map-migrate`: a map of an earlier format anew in the present one."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from sphere_nav.ros.maps.migration import migrate_map, read_layout

HELP = """\
Write a map that an earlier version made anew, in the format of this one. Pictures and ranges stay bit by bit as they
are; the map itself is never changed. Exit status 1 where there is nothing to change.

examples:
  sphere_nav map-migrate campus -o campus_2
  for map in maps/*; do sphere_nav map-migrate $map -o new_$map; done
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="NEW", help="map to write")


def run(arguments: argparse.Namespace) -> int:
    """Write the new map; 1 where the old one is as this version writes it."""
    if (layout := read_layout(arguments.map)).is_current:
        print(f"{arguments.map}: format {layout.version} already")
        return 1
    with tqdm(desc="migrate", unit="sphere", leave=False, disable=None) as bar:
        number = migrate_map(arguments.map, arguments.output, bar.update)
    print(f"{arguments.output}: {number} key spheres, from format {layout.version}")
    return 0
