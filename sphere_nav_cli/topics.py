"""Which topics of a bag a command reads: those that the user names, else what `node_kit.streams` finds."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from node_kit.bag_error import BagError
from node_kit.bag_reader import BagReader
from node_kit.bag_writer import absolute
from node_kit.streams import RGBD, STEREO, find_inputs, find_odometry, find_rig, read_streams

OPTIONS = {
    "image": ("image_raw", "images"),
    "info": ("camera_info", "calibration of the images"),
    "depth": ("depth/image_raw", "depth images"),
    "depth_info": ("depth/camera_info", "calibration of depth that is not registered to the images"),
    "left": ("left/image_raw", "images of the left camera of a pair"),
    "left_info": ("left/camera_info", "its calibration"),
    "right": ("right/image_raw", "images of the right camera of a pair"),
    "right_info": ("right/camera_info", "its calibration"),
    "odom": ("odom", "odometry"),
    "imu": ("imu", "inertial measurements"),
}
MIN_SLACK_S, MAX_SLACK_S = 0.005, 0.02  # what a moving camera can bear
KINDS = {"rgbd": RGBD, "stereo": STEREO}


def add_options(parser: argparse.ArgumentParser, names: Iterable[str], *, has_rig: bool = False) -> None:
    """Declare the options of OPTIONS that a command knows; `has_rig` adds --camera."""
    group = parser.add_argument_group("topics, found by type, name, frame and size where they are not given")
    for name in names:
        _, meaning = OPTIONS[name]
        group.add_argument(f"--{name.replace('_', '-')}", metavar="TOPIC", help=meaning)
    if has_rig:
        group.add_argument(
            "--camera", action="append", default=[], metavar="NAME=TOPIC", help="images of a camera of the rig file"
        )
    group.add_argument(
        "--remap", action="append", default=[], metavar="OURS:=THEIRS", help="any other topic, as in ROS"
    )


def chosen_topics(arguments: argparse.Namespace) -> dict[str, str]:
    """Return what the user named: our topic -> the bag's. ValueError for words that are no pair."""
    chosen = {ours: getattr(arguments, name) for name, (ours, _) in OPTIONS.items() if getattr(arguments, name, None)}
    for option, separator in (("camera", "="), ("remap", ":=")):
        for word in getattr(arguments, option, []):
            ours, found, theirs = word.partition(separator)
            if not (found and ours and theirs):
                raise ValueError(f"--{option}: expected A{separator}B, found {word!r}")
            chosen[f"cameras/{ours}/image_raw" if option == "camera" else ours.lstrip("/")] = theirs
    return chosen


def find_topics(bag: BagReader, wanted: Iterable[str], chosen: dict[str, str]) -> dict[str, str]:
    """Return the bag's topic for every one of ours; odometry where there is any."""
    streams = read_streams(bag)
    with _name_bag(bag):
        found = find_inputs(streams, wanted, chosen)
    odometry = find_odometry(streams)
    return ({"odom": odometry} if odometry else {}) | found


def find_rig_topics(bag: BagReader, names: Iterable[str], chosen: dict[str, str]) -> dict[str, str]:
    """Return the topics of images of the cameras of a rig file, by our name; BagError where none has any."""
    streams = read_streams(bag)
    named = {ours.split("/")[1] for ours in chosen if ours.startswith("cameras/")}
    found = find_rig(streams, [name for name in names if name not in named])
    topics = {f"cameras/{name}/image_raw": topic for name, topic in found.items()}
    with _name_bag(bag):
        topics |= find_inputs(streams, (), chosen)
    if not topics:
        have = ", ".join(stream.topic for stream in streams if stream.is_image) or "none"
        expected = f"images of {', '.join(names)} (rig file; or --camera NAME=TOPIC)"
        raise BagError(f"{bag.path}: topics: expected {expected}, found {have}")
    return topics


def pairing_slack(bag: BagReader, topic: str) -> float:
    """Return how far apart in s the stamps of one instant may be: a third of the period, as drivers jitter."""
    rate_hz = next(stream.rate_hz for stream in read_streams(bag) if stream.topic == absolute(topic))
    return min(max(0.33 / max(rate_hz, 1e-3), MIN_SLACK_S), MAX_SLACK_S)


def guess_kind(bag: BagReader, chosen: dict[str, str], *, has_rig: bool) -> str:
    """Return what a bag with foreign topics is: rgbd, stereo, or cameras where a rig file is given."""
    if any(ours.startswith("cameras/") for ours in chosen) or has_rig:
        return "cameras"
    for kind, word in (("stereo", "left"), ("rgbd", "depth")):
        if any(ours.startswith(word) for ours in chosen):
            return kind
    streams, reasons = read_streams(bag), []
    for kind, topics in KINDS.items():
        try:
            find_inputs(streams, topics, chosen)
        except BagError as error:
            reasons.append(str(error).removeprefix("topics: "))
        else:
            return kind
    raise BagError(f"{bag.path}: topics: no spheres; {'; '.join(reasons)}")


def options_of(topics: dict[str, str]) -> list[str]:
    """Return the options that name these topics, none for those with our own names."""
    words = []
    by_topic = {ours: f"--{name.replace('_', '-')}" for name, (ours, _) in OPTIONS.items()}
    for ours, theirs in topics.items():
        if theirs != absolute(ours):
            words += [by_topic[ours], theirs] if ours in by_topic else ["--remap", f"{ours}:={theirs}"]
    return words


@contextmanager
def _name_bag(bag: BagReader) -> Iterator[None]:
    """Lead what is said of the topics with the bag they are of."""
    try:
        yield
    except BagError as error:
        raise BagError(f"{bag.path}: {error}") from None
