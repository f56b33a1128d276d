"""`sphere_nav inspect`: what a recording of anybody's offers, what is missing for which job, and what to type."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.streams import Stream
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.tf import TransformError, TransformTree
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.importing.images import how_to_import
from sphere_nav_tools.offline.offers import find_offer
from sphere_nav_tools.offline.settings import FileAction, add, add_overwrite
from sphere_nav_tools.offline.tables import columns, write_json
from sphere_nav_tools.offline.topic_finder import TopicFinder

HELP = """\
Tell what a bag offers: its topics with type, rate, frame and size; then for mapping, localising and mcl what is
missing, or the command to type. Topics may have any names. MAP and CLOUD stand for a map and a file of geometry.

A video or a folder of images is no bag yet: the command that makes one is printed.

examples:
  sphere_nav inspect drive
  sphere_nav inspect walk_360.mp4
  sphere_nav inspect recording.mcap --json offer.json
  sphere_nav inspect six_cameras --rig rig.yaml
  sphere_nav inspect recording.db3 --driver zed --mounting 0.4,0,1.1,0,0,0
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "bag", "BAG", "a recording; or a video, or a folder of images", Path)
    add(parser, "--json", "F", "also write it as JSON", Path, action=FileAction)
    add_overwrite(parser)
    add(parser, "--rig", "F", "rig file of the cameras in the bag", Path)
    topics.add_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the topics and the offers; 1 if the bag is good for none of the jobs."""
    if words := how_to_import(arguments.bag):
        print("\n".join(words))
        return 0
    with BagReader(arguments.bag) as bag:
        finder = TopicFinder.of(bag, arguments)
        streams, (first, last) = finder.streams, bag.time_range
        mounting = describe_mountings(finder.frames, streams, arguments.mounting) + finder.frames_told[1]
        offers = [find_offer(job, finder, arguments.rig) for job in ("map", "localize", "mcl")]
    print(f"{arguments.bag}: {(last - first) * 1e-9:.1f} s, {sum(stream.count for stream in streams)} messages")
    print("\n".join(topic_table(streams)))
    drivers = [f"driver: {driver.title}: --driver {driver.name}" for driver in finder.drivers()]
    print("\n".join([*drivers, *mounting]))
    for offer in offers:
        print(f"\n{offer.job}: {(offer.note or 'ready') if offer.command else offer.missing}")
        if offer.command:
            print(f"  {shlex.join(offer.command)}")
        if offer.reason:
            print(f"  topics: {offer.reason}")
    if arguments.json:
        content = {"topics": [asdict(stream) for stream in streams], "jobs": [asdict(offer) for offer in offers]}
        write_json(arguments.json, content)
    return 0 if any(offer.command for offer in offers) else 1


def describe_mountings(frames: TransformTree, streams: Sequence[Stream], given: str) -> list[str]:
    """Return for each camera whether it is known where it sits on the vehicle; ValueError for a wrong mounting."""
    if read_mounting(given) is not None:
        return [f"mounting: {given}, for {topics.BASE_FRAME} and the camera"]
    lines = []
    for frame in dict.fromkeys(stream.frame_id for stream in streams if stream.is_picture and stream.frame_id):
        try:
            x, y, z = frames.lookup(topics.BASE_FRAME, frame).translation
        except TransformError:
            lines.append(f"mounting: {frame}: not told by /tf_static: it is taken as the vehicle; else --mounting")
        else:
            lines.append(f"mounting: {frame}: x {x:.3f}, y {y:.3f}, z {z:.3f} m on {topics.BASE_FRAME} by /tf_static")
    return lines


def topic_table(streams: Sequence[Stream]) -> list[str]:
    """Return a line for each topic."""
    rows: list[tuple[str | int, ...]] = [("topic", "type", "messages", "rate", "frame", "content")]
    for s in streams:
        size = f"{s.width} x {s.height} " if s.width else ""
        rate = f"{s.rate_hz:.1f} Hz" if s.count > 1 else ""
        content = f"{size}{s.encoding}".strip() + f" (of no use: {s.problem})" * bool(s.problem)
        rows.append((s.topic, s.type.split("/")[-1], s.count, rate, s.frame_id, content.strip()))
    return columns(rows)
