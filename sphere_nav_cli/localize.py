"""`sphere_nav localize`: a recorded camera in a map, through the very callbacks of the node."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from tqdm import tqdm

from dense_localizer.node import DenseLocalizerNode
from node_kit import conversions
from node_kit.bag_error import BagError
from node_kit.bag_reader import BagReader, Recorded
from node_kit.bag_writer import BagWriter
from node_kit.replay import OfflineBus, record, replay
from sphere_geometry import SE3
from sphere_geometry.trajectory import Trajectory, write_tum
from sphere_nav_cli.map import parsed

HELP = """\
Find the camera of a bag in a map, image by image, from colour alone. The poses of base_link in the states TRACKING and
DEGRADED are written as a TUM file: stamp x y z qx qy qz qw; their covariances beside it into a .cov file.

examples:
  sphere_nav localize kitchen drive2 -o poses.tum
  sphere_nav localize kitchen drive2 -o poses.tum --bag result --json summary.json
  sphere_nav localize campus tour -o poses.tum --image /front/image_raw --info /front/camera_info
  sphere_nav localize campus tour -o poses.tum --initial-pose 1.0,2.5,0,0,0,0,1
"""
BAD_INFO = "BAD_INFO"
TOPICS = ("/pose", "/odometry", "/status", "/tf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", metavar="MAP", help="map made by `sphere_nav map`")
    parser.add_argument("source", metavar="BAG", help="bag with images and camera_info")
    parser.add_argument("-o", "--output", required=True, metavar="TUM", help="file of poses to write")
    parser.add_argument("--bag", metavar="OUT", help="also write pose, odometry, status and tf into a bag")
    parser.add_argument("--json", metavar="FILE", help="also write the summary as JSON")
    parser.add_argument(
        "--initial-pose", metavar="x,y,z,qx,qy,qz,qw", help="pose of base_link in the map to start near"
    )
    parser.add_argument("--image", default="image_raw", metavar="TOPIC", help="images (default: %(default)s)")
    parser.add_argument("--info", default="camera_info", metavar="TOPIC", help="calibration (default: %(default)s)")
    parser.add_argument("--odom", default="odom", metavar="TOPIC", help="odometry, where there is any")
    parser.add_argument("--compressed", action="store_true", help="the images are on TOPIC/compressed")
    parser.add_argument(
        "--set", action="append", dest="settings", default=[], metavar="NAME=VALUE", help="parameter of dense_localizer"
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
        values = {"map": arguments.map, "transport": "compressed" if arguments.compressed else "raw"}
        image = arguments.image + ("/compressed" if arguments.compressed else "")
        name = "image_raw/compressed" if arguments.compressed else "image_raw"
        remap = {name: image, "camera_info": arguments.info, "odom": arguments.odom}
        node = bus.add(DenseLocalizerNode, values | parsed(arguments.settings), remap)
        if arguments.initial_pose:
            give_initial_pose(node, arguments.initial_pose)
        total = sum(bag.topics[topic].count for topic in bus.listeners if topic in bag.topics)
        bar = stack.enter_context(tqdm(total=total, desc="localize", unit="msg", disable=None))
        published = replay(bag, bus, progress=bar.update)
        published = usable(published, arguments.source)
        if arguments.bag:
            published = record(published, stack.enter_context(BagWriter(arguments.bag)), bus)
        yield from published


def usable(published: Iterator[Recorded], source: str) -> Iterator[Recorded]:
    """Pass on what is published; BagError at the end where no image fitted its calibration."""
    refusal, is_usable = "", False
    for item in published:
        if item.topic == "/status":
            status = conversions.message_to_status(item.message)
            is_usable |= status.reason != BAD_INFO
            refusal = status.remedy
        yield item
    if refusal and not is_usable:
        raise BagError(f"{source}: every image refused: {refusal}")


def give_initial_pose(node: Any, text: str) -> None:
    """Hand the pose to the node as the topic initialpose would."""
    try:
        numbers = [float(word) for word in text.split(",")]
        if len(numbers) != 7:
            raise ValueError
        T_map_base = SE3.from_quaternion(numbers[3:], numbers[:3])
    except ValueError:
        raise ValueError(f"--initial-pose: expected x,y,z,qx,qy,qz,qw, found {text!r}") from None
    message: PoseWithCovarianceStamped = conversions.se3_to_pose_with_covariance(
        T_map_base, np.zeros((6, 6)), 0, node.params.map_frame
    )
    node.on_initial_pose(message)


class Summary:
    """Collects what the node says."""

    def __init__(self) -> None:
        self.poses: list[tuple[int, SE3, NDArray[np.float64]]] = []
        self.states: Counter[str] = Counter()
        self.reasons: Counter[str] = Counter()
        self.milliseconds: list[float] = []

    def take(self, item: Recorded) -> None:
        """Take one message."""
        if item.topic == "/status":
            status = conversions.message_to_status(item.message)
            self.states[status.state] += 1
            if status.reason:
                self.reasons[status.reason] += 1
            if status.milliseconds > 0.0:
                self.milliseconds.append(status.milliseconds)
        elif item.topic == "/pose":
            pose = conversions.pose_with_covariance_to_se3(item.message)
            self.poses.append((conversions.stamp_ns(item.message), *pose))

    def trajectory(self) -> Trajectory:
        """Return the poses with their covariances."""
        stamps = np.array([stamp for stamp, _, _ in self.poses], dtype=np.int64)
        matrices = np.array([pose.matrix for _, pose, _ in self.poses]).reshape(-1, 4, 4)
        covariances = np.array([covariance for _, _, covariance in self.poses]).reshape(-1, 6, 6)
        return Trajectory(stamps, SE3(matrices), covariances)

    def result(self) -> dict[str, Any]:
        """Return the figures."""
        times = np.array(self.milliseconds or [0.0])
        return {
            "images": sum(self.states.values()),
            "poses": len(self.poses),
            "states": dict(self.states),
            "reasons": dict(self.reasons),
            "milliseconds": {"median": float(np.median(times)), "p99": float(np.percentile(times, 99))},
        }

    def text(self, result: dict[str, Any], output: Path) -> str:
        """Return the figures in a few lines."""
        counts = (", ".join(f"{word} {count}" for word, count in result[key].items()) for key in ("states", "reasons"))
        times = result["milliseconds"]
        return "\n".join(
            (
                f"{result['images']} images, {result['poses']} poses -> {output}",
                *(f"{name:<8}{text or 'none'}" for name, text in zip(("states", "reasons"), counts, strict=True)),
                f"time    median {times['median']:.1f} ms, p99 {times['p99']:.1f} ms an image",
            )
        )
