"""`sphere_nav inspect`: what a recording of anybody's offers, what is missing for which job, and what to type."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from node_kit.bag_error import BagError
from node_kit.bag_reader import BagReader
from node_kit.streams import CLOUD, RGBD, SPHERE, SPHERE_INFO, STEREO, Stream, find_inputs, find_odometry, read_streams
from sphere_nav_cli.topics import options_of

HELP = """\
Tell what a bag offers: its topics with type, rate, frame and size; then for mapping, localising and mcl what is
missing, or the command to type. Topics may have any names.

examples:
  sphere_nav inspect drive
  sphere_nav inspect recording.mcap --json offer.json
"""
MIN_RIG_CAMERAS = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="a recording")
    parser.add_argument("--json", type=Path, metavar="F", help="also write it as JSON")


@dataclass
class Offer:
    """What a bag does for one job."""

    job: str
    command: list[str] = field(default_factory=list)  # empty: it does not
    missing: str = ""
    note: str = ""


def run(arguments: argparse.Namespace) -> int:
    """Print the topics and the offers; 1 if the bag is good for none of the jobs."""
    with BagReader(arguments.bag) as bag:
        streams = read_streams(bag)
        first, last = bag.time_range
    offers = find_offers(streams, arguments.bag)
    print(f"{arguments.bag}: {(last - first) * 1e-9:.1f} s, {sum(stream.count for stream in streams)} messages")
    print("\n".join(table(streams)))
    for offer in offers:
        print(f"\n{offer.job}: {offer.note or 'ready'}" if offer.command else f"\n{offer.job}: {offer.missing}")
        if offer.command:
            print(f"  {shlex.join(offer.command)}")
    if arguments.json:
        content = {"topics": [asdict(stream) for stream in streams], "jobs": [asdict(offer) for offer in offers]}
        arguments.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return 0 if any(offer.command for offer in offers) else 1


def table(streams: Sequence[Stream]) -> list[str]:
    """Return a line for each topic."""
    rows = [("topic", "type", "messages", "rate", "frame", "content")]
    for s in streams:
        size = f"{s.width} x {s.height} " if s.width else ""
        rate = f"{s.rate_hz:.1f} Hz" if s.count > 1 else ""
        rows.append((s.topic, s.type.split("/")[-1], str(s.count), rate, s.frame_id, f"{size}{s.encoding}".strip()))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def find_offers(streams: Sequence[Stream], bag: Path) -> list[Offer]:
    """Return what can be done with a bag: map, localise, mcl."""
    return [_mapping(streams, bag), _localising(streams, bag), _monte_carlo(streams, bag)]


def _mapping(streams: Sequence[Stream], bag: Path) -> Offer:
    command = ["sphere_nav", "map", str(bag), "-o", f"{bag.stem}_map"]
    if any(stream.type == SPHERE for stream in streams):
        return Offer("map", command, note="from spheres")
    reasons = []
    for wanted, note in ((RGBD, "from colour and depth"), (STEREO, "from a rectified stereo pair")):
        try:
            topics = find_inputs(streams, wanted)
        except BagError as error:
            reasons.append(str(error).removeprefix("topics: "))
            continue
        if "depth/camera_info" in topics:
            note += ", depth registered to the images by both calibrations and /tf_static"
        return Offer("map", command + options_of(topics), note=note)
    cameras = [stream for stream in streams if stream.is_picture and "/left" not in stream.topic]
    if len({camera.base for camera in cameras}) >= MIN_RIG_CAMERAS:
        names = [f"--camera=NAME={camera.topic}" for camera in cameras]
        note = "from the cameras of a rig, with its calibration (sphere_nav calibrate, or rig-convert)"
        return Offer("map", [*command, "--rig", "rig.yaml", *names], note=note)
    return Offer("map", missing="; ".join(reasons))


def _localising(streams: Sequence[Stream], bag: Path) -> Offer:
    try:
        topics = find_inputs(streams, ("image_raw", "camera_info"))
    except BagError as error:
        return Offer("localize", missing=str(error).removeprefix("topics: "))
    odometry = find_odometry(streams)
    topics |= {"odom": odometry} if odometry else {}
    command = ["sphere_nav", "localize", "MAP", str(bag), "-o", f"{bag.stem}.tum"]
    return Offer("localize", command + options_of(topics), note="ready, with odometry" if odometry else "")


def _monte_carlo(streams: Sequence[Stream], bag: Path) -> Offer:
    has_sphere = any(stream.type == SPHERE_INFO for stream in streams)
    try:
        topics = find_inputs(streams, ("image_raw",) if has_sphere else ("image_raw", "camera_info"))
    except BagError as error:
        return Offer("mcl", missing=str(error).removeprefix("topics: "))
    odometry = find_odometry(streams)
    if not odometry:
        return Offer("mcl", missing="expected odometry (nav_msgs/Odometry), found none")
    clouds = [stream.topic for stream in streams if stream.type == CLOUD]
    note = f"ready; the bag has point clouds, too ({', '.join(clouds)})" if clouds else ""
    command = ["sphere_nav", "mcl", "CLOUD", str(bag), "-o", f"{bag.stem}.tum"]
    return Offer("mcl", command + options_of(topics | {"odom": odometry}), note=note)
