"""`sphere_nav mcl`: a recorded camera in a point cloud, through the very callbacks of the node."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from tqdm import tqdm

from mcl_depth.node import MclDepthNode
from node_kit.bag_reader import BagReader, Recorded
from node_kit.bag_writer import BagWriter
from node_kit.replay import OfflineBus, record, replay
from sphere_geometry.trajectory import write_tum
from sphere_nav_cli.localize import Summary, usable
from sphere_nav_cli.map import parsed

HELP = """\
Find the camera of a bag in bare geometry, from nowhere. CLOUD is .ply, .pcd, .las, .npy, a floor plan .csv, or a map
made by `sphere_nav map`. The poses of base_link in the states TRACKING and DEGRADED are written as a TUM file.

examples:
  sphere_nav mcl town.ply drive -o poses.tum
  sphere_nav mcl campus drive2 -o poses.tum --bag result --set resampling.num_particles=2000
"""
TOPICS = ("/pose", "/status", "/tf", "/particle_cloud", "/heading")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("cloud", metavar="CLOUD", help="geometry to localise in")
    parser.add_argument("source", metavar="BAG", help="bag with images, camera_info or sphere_info, and odometry")
    parser.add_argument("-o", "--output", required=True, metavar="TUM", help="file of poses to write")
    parser.add_argument("--bag", metavar="OUT", help="also write what the node publishes into a bag")
    parser.add_argument("--json", metavar="FILE", help="also write the summary as JSON")
    parser.add_argument("--image", default="image_raw", metavar="TOPIC", help="images (default: %(default)s)")
    parser.add_argument("--info", default="camera_info", metavar="TOPIC", help="calibration (default: %(default)s)")
    parser.add_argument("--odom", default="odom", metavar="TOPIC", help="odometry (default: %(default)s)")
    parser.add_argument(
        "--set", action="append", dest="settings", default=[], metavar="NAME=VALUE", help="parameter of mcl_depth"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the files that are there")


def run(arguments: argparse.Namespace) -> int:
    """Localise every image; 1 if none could be localised."""
    output = Path(arguments.output)
    for path in (output, arguments.json and Path(arguments.json)):
        if path and path.exists() and not arguments.overwrite:
            raise ValueError(f"{path}: expected no such file, found one: --overwrite replaces it")
    summary = Summary()
    for item in localised(arguments):
        summary.take(item)
    write_tum(output, summary.trajectory())
    result = summary.result()
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(summary.text(result, output))
    return 0 if result["poses"] else 1


def localised(arguments: argparse.Namespace) -> Iterator[Recorded]:
    """Yield what the node publishes while the bag is replayed."""
    with ExitStack() as stack:
        bag = stack.enter_context(BagReader(arguments.source))
        bus = OfflineBus(captured=set(TOPICS))
        stack.callback(bus.close)
        remap = {"image_raw": arguments.image, "camera_info": arguments.info, "odom": arguments.odom}
        bus.add(MclDepthNode, {"cloud": arguments.cloud} | parsed(arguments.settings), remap)
        total = sum(bag.topics[topic].count for topic in bus.listeners if topic in bag.topics)
        bar = stack.enter_context(tqdm(total=total, desc="mcl", unit="msg", disable=None))
        published = usable(replay(bag, bus, progress=bar.update), arguments.source)
        if arguments.bag:
            published = record(published, stack.enter_context(BagWriter(arguments.bag)), bus)
        yield from published
