"""`sphere_nav inspect`: what a recording of anybody's offers, what is missing for which job, and what to type."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from sphere_nav.offline import topics
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import CLOUD, RGBD, SPHERE, SPHERE_INFO, STEREO, Stream, find_odometry, read_streams
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.tf import TransformTree

HELP = """\
Tell what a bag offers: its topics with type, rate, frame and size; then for mapping, localising and mcl what is
missing, or the command to type. Topics may have any names.

examples:
  sphere_nav inspect drive
  sphere_nav inspect recording.mcap --json offer.json
  sphere_nav inspect recording.db3 --driver zed --mounting 0.4,0,1.1,0,0,0
"""
MIN_RIG_CAMERAS = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="a recording")
    parser.add_argument("--json", type=Path, metavar="F", help="also write it as JSON")
    topics.add_options(parser)


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
        chosen = topics.choose_topics(bag, arguments)
        frames = topics.read_frames(bag)
    mounting = describe_mountings(frames, streams, arguments.mounting)
    offers = find_offers(streams, arguments.bag, chosen)
    check_registration(offers, streams, frames)
    if arguments.mounting:
        for offer in offers:
            offer.command += ["--mounting", arguments.mounting] if offer.command else []
    print(f"{arguments.bag}: {(last - first) * 1e-9:.1f} s, {sum(stream.count for stream in streams)} messages")
    print("\n".join(topic_table(streams)))
    print("\n".join([*driver_lines(streams), *mounting]))
    for offer in offers:
        print(f"\n{offer.job}: {offer.note or 'ready'}" if offer.command else f"\n{offer.job}: {offer.missing}")
        if offer.command:
            print(f"  {shlex.join(offer.command)}")
    if arguments.json:
        content = {"topics": [asdict(stream) for stream in streams], "jobs": [asdict(offer) for offer in offers]}
        arguments.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return 0 if any(offer.command for offer in offers) else 1


def driver_lines(streams: Sequence[Stream]) -> list[str]:
    """Return which drivers are known by their topics, and what they publish otherwise than usual."""
    by_name, lines = {stream.topic: stream for stream in streams}, []
    for driver in topics.find_drivers(streams):
        lines.append(f"driver: {driver.title}: --driver {driver.name}")
        for ours, theirs in driver.find(by_name).items():
            usual, found = driver.encodings.get(ours, ()), by_name[theirs].encoding
            if usual and found not in usual and "compressed" not in found:
                lines.append(f"  {theirs}: usually {' or '.join(usual)}, here {found}")
    return lines


def check_registration(offers: Sequence[Offer], streams: Sequence[Stream], frames: TransformTree) -> None:
    """Withdraw the offer to register depth where nobody tells how its camera sits beside the other."""
    by_name = {stream.topic: stream for stream in streams}
    for offer in offers:
        if "--depth-info" in offer.command:
            words = dict(zip(offer.command, offer.command[1:], strict=False))
            image = by_name[words.get("--info", "/camera_info")].frame_id
            depth = by_name[words["--depth-info"]].frame_id
            if not frames.is_connected(image, depth):
                offer.command = []
                offer.missing = (
                    f"expected {depth} and {image} on /tf_static, found no way: record it, or registered depth"
                )


def describe_mountings(frames: TransformTree, streams: Sequence[Stream], given: str) -> list[str]:
    """Return for each camera whether it is known where it sits on the vehicle; ValueError for a wrong mounting."""
    if read_mounting(given) is not None:
        return [f"mounting: {given}, for {topics.BASE_FRAME} and the camera"]
    lines = []
    for frame in dict.fromkeys(stream.frame_id for stream in streams if stream.is_picture and stream.frame_id):
        try:
            x, y, z = frames.lookup(topics.BASE_FRAME, frame).translation
        except ValueError:
            lines.append(f"mounting: {frame}: not told by /tf_static: it is taken as the vehicle; else --mounting")
        else:
            lines.append(f"mounting: {frame}: x {x:.3f}, y {y:.3f}, z {z:.3f} m on {topics.BASE_FRAME} by /tf_static")
    return lines


def topic_table(streams: Sequence[Stream]) -> list[str]:
    """Return a line for each topic."""
    rows = [("topic", "type", "messages", "rate", "frame", "content")]
    for s in streams:
        size = f"{s.width} x {s.height} " if s.width else ""
        rate = f"{s.rate_hz:.1f} Hz" if s.count > 1 else ""
        rows.append((s.topic, s.type.split("/")[-1], str(s.count), rate, s.frame_id, f"{size}{s.encoding}".strip()))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def find_offers(streams: Sequence[Stream], bag: Path, chosen: dict[str, str]) -> list[Offer]:
    """Return what can be done with a bag, some of whose topics are named: map, localise, mcl."""
    return [job(streams, bag, chosen) for job in (_mapping, _localising, _monte_carlo)]


def _mapping(streams: Sequence[Stream], bag: Path, chosen: dict[str, str]) -> Offer:
    command = ["sphere_nav", "map", str(bag), "-o", f"{bag.stem}_map"]
    if any(stream.type == SPHERE for stream in streams):
        return Offer("map", command, note="from spheres")
    reasons = []
    for wanted, note in ((RGBD, "from colour and depth"), (STEREO, "from a stereo pair")):
        try:
            found = topics.find_wanted(streams, wanted, _of_kind(chosen, wanted))
        except BagError as error:
            reasons.append(str(error).removeprefix("topics: "))
            continue
        if "depth/camera_info" in found:
            note += ", depth registered to the images by both calibrations and /tf_static"
        return Offer("map", command + topics.options_of(found), note=note)
    cameras = [stream for stream in streams if stream.is_picture]
    has_depth = any(stream.is_depth for stream in streams)
    if not has_depth and len({camera.frame_id or camera.base for camera in cameras}) >= MIN_RIG_CAMERAS:
        names = [f"--camera=NAME={camera.topic}" for camera in cameras]
        note = "from the cameras of a rig, with its calibration (sphere_nav calibrate, or rig-convert)"
        return Offer("map", [*command, "--rig", "rig.yaml", *names], note=note)
    return Offer("map", missing="; ".join(reasons))


def _localising(streams: Sequence[Stream], bag: Path, chosen: dict[str, str]) -> Offer:
    try:
        found = topics.find_wanted(streams, ("image_raw", "camera_info"), _of_kind(chosen, ("image_raw",)))
    except BagError as error:
        return Offer("localize", missing=str(error).removeprefix("topics: "))
    odometry = find_odometry(streams)
    found = ({"odom": odometry} if odometry else {}) | found
    command = ["sphere_nav", "localize", "MAP", str(bag), "-o", f"{bag.stem}.tum"]
    return Offer("localize", command + topics.options_of(found), note="ready, with odometry" if odometry else "")


def _monte_carlo(streams: Sequence[Stream], bag: Path, chosen: dict[str, str]) -> Offer:
    has_sphere = any(stream.type == SPHERE_INFO for stream in streams)
    try:
        wanted = ("image_raw",) if has_sphere else ("image_raw", "camera_info")
        found = topics.find_wanted(streams, wanted, _of_kind(chosen, wanted))
    except BagError as error:
        return Offer("mcl", missing=str(error).removeprefix("topics: "))
    odometry = find_odometry(streams)
    if not odometry:
        return Offer("mcl", missing="expected odometry (nav_msgs/Odometry), found none")
    clouds = [stream.topic for stream in streams if stream.type == CLOUD]
    note = f"ready; the bag has point clouds, too ({', '.join(clouds)})" if clouds else ""
    command = ["sphere_nav", "mcl", "CLOUD", str(bag), "-o", f"{bag.stem}.tum"]
    return Offer("mcl", command + topics.options_of({"odom": odometry} | found), note=note)


def _of_kind(chosen: dict[str, str], wanted: Sequence[str]) -> dict[str, str]:
    """Return what is named of the cameras that a job wants, and odometry."""
    words = {topic.split("/")[0] for topic in wanted} | {"camera_info", "odom", "imu"}
    return {ours: topic for ours, topic in chosen.items() if ours.split("/")[0] in words}
