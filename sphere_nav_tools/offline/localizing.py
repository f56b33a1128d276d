"""What the commands that localise a recording share: arguments, its camera, the replay through a node, the figures.

Recordings with few images: a localiser must wait for the next one longer than behind a live camera.
"""

from __future__ import annotations

import argparse
import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.trajectory import Trajectory, write_tum
from sphere_nav.localization.params import InputParams
from sphere_nav.localization.status import Reason, Status
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError, Recorded
from sphere_nav.ros.bags.replay import OfflineBus, record, replay, required_topics
from sphere_nav.ros.bags.streams import Stream
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.node import ManagedNode
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.constants import SILENT_PERIODS
from sphere_nav_tools.offline.evaluation import PoseReading, sort_poses
from sphere_nav_tools.offline.settings import FileAction, add, add_output, add_settings, read_pose
from sphere_nav_tools.offline.tables import columns, progress, write_json
from sphere_nav_tools.offline.topic_finder import TopicFinder

TIMEOUT = "input.timeout_s"


def add_arguments(parser: argparse.ArgumentParser, node: str) -> None:
    """Declare the arguments that do not depend on what is localised in; `node` is whose parameters `--set` sets."""
    add_output(parser, "TUM", "file of poses to write")
    add(parser, "--bag", "OUT", "also write what the node publishes into a bag")
    add(parser, "--json", "FILE", "also write the summary as JSON", Path, action=FileAction)
    topics.add_options(parser)
    add_settings(parser, node)
    add(parser, "--initial-pose", "x,y,z,qx,qy,qz,qw", "pose of base_link in the map to start near", read_pose)


def write_poses(arguments: argparse.Namespace, published: Iterator[Recorded]) -> int:
    """Write the poses and the summary of what a node published; 1 if there is no pose."""
    output = arguments.output
    poses, statuses = collect(published)
    if len(poses):
        write_tum(output, poses)
    result = summarize(poses, statuses)
    if arguments.json:
        write_json(arguments.json, result)
    print(f"{result['images']} images, {result['poses']} poses" + f" -> {output}" * bool(len(poses)))
    print("\n".join(describe_states(statuses)))
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
        remap = finder.odometry | finder.find_localizer(arguments.settings).topics
        images = (topic for ours, topic in remap.items() if ours.endswith("image_raw"))
        cameras = topics.camera_names(remap)
        given: dict[str, Any] = {"rig.cameras": ",".join(cameras)} if cameras else {}
        given |= finder.place_camera(remap, arguments.settings) | patience(finder.streams, images)
        given |= dict(values) | arguments.settings
        node: Any = bus.add(kind, given, remap)
        if arguments.initial_pose is not None:
            told = conversions.se3_to_pose_with_covariance(
                arguments.initial_pose, np.zeros((6, 6)), 0, node.params.map_frame
            )
            node.on_initial_pose(told)  # as the topic initialpose would
        finder.refuse_unread(wanted.topic for node in bus.nodes for wanted in node.inputs)
        published = replay_shown("localise", "msg", bag, bus)
        if arguments.bag:
            published = record(published, stack.enter_context(BagWriter(arguments.bag)), bus)
        yield from published


def replay_shown(what: str, unit: str, bag: BagReader, bus: OfflineBus) -> Iterator[Recorded]:
    """Play a bag to the nodes of a bus, shown by a bar; yield what they publish."""
    total = sum(bag.topics[topic].count for topic in required_topics(bag, bus))
    with progress(what, unit, total=total) as bar:
        yield from replay(bag, bus, progress=bar.update)


def summarize(poses: Trajectory, statuses: Sequence[Status]) -> dict[str, Any]:
    """Return the figures of what a localiser said."""
    answers = [status for status in statuses if status.reason != Reason.TIMEOUT]
    times = milliseconds(statuses) or [0.0]
    return {
        "images": len(answers),
        "poses": len(poses),
        "states": Counter(str(status.state) for status in answers),
        "reasons": Counter(str(status.reason) for status in answers if status.reason),
        "milliseconds": {"median": float(np.median(times)), "p99": float(np.percentile(times, 99))},
    }


def collect(published: Iterable[Recorded]) -> tuple[Trajectory, list[Status]]:
    """Return what a node says on pose and status; poses are sorted: a clock may have been set back, which is told.

    BagError where it answers no image.
    """
    stamps, poses, statuses = list[int](), dict[int, PoseReading](), list[Status]()
    for item in published:
        if item.topic == "/status":
            statuses.append(conversions.message_to_status(item.message))
        elif item.topic == "/pose":
            stamps.append(conversions.stamp_ns(item.message))
            poses[stamps[-1]] = conversions.pose_with_covariance_to_se3(item.message)
    if not poses and all(status.reason == Reason.TIMEOUT for status in statuses):
        raise BagError("no image answered: expected a camera_info of each image's camera, found none in time")
    if num_set_back := int(np.sum(np.diff(stamps) <= 0)):
        text = "stamps go back %d times: the poses are sorted by stamp; of two with the same stamp the last one holds"
        logging.getLogger("sphere_nav.clock").warning(text, num_set_back)
    return sort_poses(poses), statuses


def milliseconds(statuses: Sequence[Status]) -> list[float]:
    """Return the time for each image; a time-out, between images that are far apart, answers none."""
    return [one.milliseconds for one in statuses if one.reason != Reason.TIMEOUT and one.milliseconds > 0]


def describe_states(statuses: Sequence[Status]) -> list[str]:
    """Return how often each state was told for each reason, with the remedy, and the time for an image."""
    counts = Counter((str(status.state), str(status.reason)) for status in statuses)
    remedies = {(str(status.state), str(status.reason)): status.remedy for status in statuses}
    lines = columns((number, *told, remedies[told]) for told, number in counts.most_common())
    if times := milliseconds(statuses):
        lines.append(f"time for an image: median {np.median(times):.1f} ms, p99 {np.percentile(times, 99):.1f} ms")
    return lines


def patience(streams: Sequence[Stream], images: Iterable[str]) -> dict[str, float]:
    """Return the time-out for the slowest of the topics with images, where the default is too short for it."""
    wanted, default = set(images), InputParams().timeout_s
    slowest_hz = min((s.rate_hz for s in streams if s.topic in wanted and s.count > 1), default=0.0)
    if slowest_hz <= 0.0 or SILENT_PERIODS / slowest_hz <= default:
        return {}
    timeout_s = round(SILENT_PERIODS / slowest_hz, 3)
    text = f"an image every {1.0 / slowest_hz:.2f} s: {TIMEOUT}={timeout_s:g} (else {default:g})"
    logging.getLogger("sphere_nav.slow_camera").warning(text)
    return {TIMEOUT: timeout_s}


class RecordedCamera:
    """Found by the options of `topics.add_options`; BagError where there is none.

    `patience` is what a localiser is to be given where its images are far apart, `odometry` the topic of it, if any,
    `frames` are those of the bag.
    """

    def __init__(self, path: str | Path, arguments: argparse.Namespace) -> None:
        self._path = path
        with BagReader(path) as bag:
            finder = TopicFinder.of(bag, arguments)
            self._topics = finder.odometry | finder.find(("image_raw", "camera_info")).topics
            told = next(iter(bag.messages([self._topics["camera_info"]]))).message
            info = conversions.as_rectified(
                told, is_rectified=conversions.is_rectified_topic(self._topics["image_raw"])
            )
            self.frames, self.patience = finder.frames, patience(finder.streams, [self._topics["image_raw"]])
        self.camera, self.frame_id = conversions.camera_from_info(info), str(info.header.frame_id)
        self.odometry = self._topics.get("odom", "")

    def images(self) -> Iterator[tuple[int, Bytes]]:
        """Yield stamp in ns and image (H, W) grey or (H, W, 3) RGB, raw or compressed."""
        levels = conversions.Levels()
        with BagReader(self._path) as bag:
            for _, _, message in bag.messages([self._topics["image_raw"]]):
                yield conversions.stamp_ns(message), conversions.image_to_rgb(message, levels)
