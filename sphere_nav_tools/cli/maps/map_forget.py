"""`sphere_nav map-forget`: a new map without what drives have rejected again and again."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from dense_localizer.references.rejections import read_rejections
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.offline.forgetting import save_without, together

HELP = """\
Make a new map of one and of what `sphere_nav localize --rejections` has counted in it: squares of key spheres that most
images contradicted (leaves, a car that was parked there) lose their range, so that no image is aligned with them. The
map itself is never changed. Several drives count together.

examples:
  sphere_nav localize campus tuesday -o tuesday.tum --rejections tuesday.json
  sphere_nav localize campus friday -o friday.tum --rejections friday.json
  sphere_nav map-forget campus tuesday.json friday.json -o campus_2
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    parser.add_argument(
        "rejections", type=Path, nargs="+", metavar="FILE", help="what localize --rejections has written"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="NEW", help="map to write")


def run(arguments: argparse.Namespace) -> int:
    """Write the new map; 1 where there is nothing to forget."""
    with open_map(arguments.map) as reader:
        map_id = str(reader.info.map_id)
        rejections = together([read_rejections(path, map_id) for path in arguments.rejections])
        shares = [share for share in (rejections.share(node.id) for node in reader.graph) if share]
        if not shares:
            print(f"{arguments.map}: nothing to forget")
            return 1
        with tqdm(total=len(reader.graph), desc="forget", unit="sphere", disable=None) as bar:
            save_without(reader, rejections, arguments.output, bar.update)
    print(f"{arguments.output}: {len(shares)} key spheres, up to {max(shares):.1%} of their pixels forgotten")
    return 0
