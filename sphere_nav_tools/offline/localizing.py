"""What the commands that localise a recording share: arguments, the replay through a node, the figures."""

from __future__ import annotations

import argparse
import logging
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from tqdm import tqdm

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory, write_tum
from sphere_nav.localization.status import Reason
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError, Recorded
from sphere_nav.ros.bags.replay import OfflineBus, record, replay
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.node import ManagedNode
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.recorded_camera import patience
from sphere_nav_tools.offline.settings import add_overwrite, add_settings, check_free, numbers_of
from sphere_nav_tools.offline.tables import write_json
from sphere_nav_tools.offline.topic_finder import TopicFinder

UNUSABLE = (Reason.BAD_INFO, Reason.MAP_ERROR, Reason.BAD_STAMP, Reason.TF_STALE)  # an image that was not compared


def add_arguments(parser: argparse.ArgumentParser, node: str) -> None:
    """Declare the arguments that do not depend on what is localised in; `node` is whose parameters `--set` sets."""
    parser.add_argument("-o", "--output", required=True, metavar="TUM", help="file of poses to write")
    parser.add_argument("--bag", metavar="OUT", help="also write what the node publishes into a bag")
    parser.add_argument("--json", metavar="FILE", help="also write the summary as JSON")
    topics.add_options(parser)
    add_settings(parser, node)
    add_overwrite(parser)
    parser.add_argument(
        "--initial-pose", metavar="x,y,z,qx,qy,qz,qw", help="pose of base_link in the map to start near"
    )


def write_poses(arguments: argparse.Namespace, published: Iterator[Recorded]) -> int:
    """Write the poses and the summary of what a node published; 1 if there is no pose. ValueError for files there."""
    output = Path(arguments.output)
    check_free(arguments, output, arguments.json and Path(arguments.json))
    summary = Summary()
    for item in published:
        summary.take(item)
    if summary.num_set_back:
        text = "stamps go back %d times: the poses are sorted by stamp; of two with the same stamp the last one holds"
        logging.getLogger("sphere_nav.clock").warning(text, summary.num_set_back)
    write_tum(output, summary.trajectory())
    result = summary.result()
    if arguments.json:
        write_json(arguments.json, result)
    print(summary.text(result, output))
    return 0 if result["poses"] else 1


def replay_localizer(
    arguments: argparse.Namespace,
    published_topics: tuple[str, ...],
    kind: type[ManagedNode],
    values: Mapping[str, Any],
) -> Iterator[Recorded]:
    """Yield what a node publishes while the bag plays; `values`: its parameters that no --set has changed."""
    with ExitStack() as stack:
        bag = stack.enter_context(BagReader(arguments.source))
        bus = OfflineBus(set(published_topics), start_ns=bag.time_range[0])
        stack.callback(bus.close)
        finder = TopicFinder.of(bag, arguments)
        remap = finder.require(finder.find_localizer(arguments.settings))
        mounting = arguments.mounting
        if not mounting and "image_raw" in remap:
            mounting = finder.note_mounting(remap["image_raw"], arguments.settings)
        images = (topic for ours, topic in remap.items() if ours.endswith("image_raw"))
        given = {"mounting": mounting, "camera_frame": finder.odd_frame(remap)}
        given |= patience(finder.streams, images) | dict(values) | arguments.settings
        if cameras := topics.camera_names(remap):
            given["rig.cameras"] = given.get("rig.cameras", ",".join(cameras))
        node = bus.add(kind, given, remap)
        if arguments.initial_pose:
            give_initial_pose(node, arguments.initial_pose)
        finder.refuse_unread(wanted.topic for node in bus.nodes for wanted in node.inputs)
        total = sum(bag.topics[topic].count for topic in bus.listeners if topic in bag.topics)
        bar = stack.enter_context(tqdm(total=total, desc="localise", unit="msg", disable=None))
        published = usable(replay(bag, bus, progress=bar.update), arguments.source)
        if arguments.bag:
            published = record(published, stack.enter_context(BagWriter(arguments.bag)), bus)
        yield from published


def usable(published: Iterator[Recorded], source: str) -> Iterator[Recorded]:
    """Pass on what is published; BagError at the end where no image could be compared: bad stamps, calibration, map."""
    refusal, is_usable, is_answered = "", False, False
    for item in published:
        status = conversions.message_to_status(item.message) if item.topic == "/status" else None
        if status is not None and status.reason != Reason.TIMEOUT:  # which answers no image
            is_answered = True
            is_usable |= status.reason not in UNUSABLE
            refusal = refusal or status.remedy
        yield item
    if not is_answered:
        raise BagError(
            f"{source}: no image answered: expected a camera_info of each image's camera, found none in time"
        )
    if refusal and not is_usable:
        raise BagError(f"{source}: every image refused: {refusal}")


class Summary:
    """Collects what the node says."""

    def __init__(self) -> None:
        self.poses: dict[int, tuple[SE3, Array]] = {}  # by stamp in ns
        self.num_set_back = 0  # poses whose stamp is not later than that of the one before
        self._last_ns = 0
        self.states: Counter[str] = Counter()
        self.reasons: Counter[str] = Counter()
        self.milliseconds: list[float] = []

    def take(self, item: Recorded) -> None:
        """Take one message."""
        if item.topic == "/status":
            status = conversions.message_to_status(item.message)
            if status.reason == Reason.TIMEOUT:  # between images that are far apart; no answer to one
                return
            self.states[status.state] += 1
            if status.reason:
                self.reasons[status.reason] += 1
            if status.milliseconds > 0.0:
                self.milliseconds.append(status.milliseconds)
        elif item.topic == "/pose":
            pose = conversions.pose_with_covariance_to_se3(item.message)
            stamp = conversions.stamp_ns(item.message)
            self.num_set_back += stamp <= self._last_ns
            self.poses[stamp], self._last_ns = pose, stamp

    def trajectory(self) -> Trajectory:
        """Return the poses with their covariances, by stamp: a clock may have been set back."""
        stamps = sorted(self.poses)
        poses = [self.poses[stamp] for stamp in stamps]
        matrices = np.array([pose.matrix for pose, _ in poses]).reshape(-1, 4, 4)
        covariances = np.array([covariance for _, covariance in poses]).reshape(-1, 6, 6)
        return Trajectory(np.array(stamps, dtype=np.int64), SE3(matrices), covariances)

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


def give_initial_pose(node: Any, text: str) -> None:
    """Hand the pose to the node as the topic initialpose would."""
    expected = "x,y,z,qx,qy,qz,qw"
    numbers = numbers_of(text, "--initial-pose", expected, 7)
    try:
        T_map_base = SE3.from_quaternion(numbers[3:], numbers[:3])
    except ValueError as error:
        raise ValueError(f"--initial-pose: expected {expected}, found {text!r}: {error}") from None
    message: PoseWithCovarianceStamped = conversions.se3_to_pose_with_covariance(
        T_map_base, np.zeros((6, 6)), 0, node.params.map_frame
    )
    node.on_initial_pose(message)
