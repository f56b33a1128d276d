"""Which topics of a bag a command reads: those that the user names, else what `sphere_nav.ros.bags.streams` finds."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any

import numpy as np

from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.samples import IMU, SPHERE, SPHERE_INFO
from sphere_nav.ros.bags.streams import (
    RGBD,
    STEREO,
    Stream,
    find_inputs,
    find_odometry,
    find_rig,
    info_of,
    is_usable,
    read_streams,
)
from sphere_nav.ros.bags.writer import absolute
from sphere_nav.ros.camera.drivers import INPUTS, Driver, driver_names, read_driver
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.offline.constants import NUM_PAIRED, NUM_TF_MESSAGES, SLACK_S

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
BASE_FRAME, TF_TOPIC, TF_STATIC_TOPIC = "base_link", "/tf", "/tf_static"
CAMERA_IS_VEHICLE = "0,0,0,0,0,0"  # a mounting
KINDS = {"rgbd": RGBD, "stereo": STEREO}


def add_options(parser: argparse.ArgumentParser, *, has_cameras: bool = True) -> None:
    """Declare what every command that uses the topics of a bag takes; without --camera where that means a lens."""
    group = parser.add_argument_group("topics, found by driver, type, name, frame and size where they are not given")
    for name, (_, meaning) in OPTIONS.items():
        group.add_argument(f"--{name.replace('_', '-')}", metavar="TOPIC", help=meaning)
    if has_cameras:
        group.add_argument(
            "--camera", action="append", default=[], metavar="NAME=TOPIC", help="images of a camera of a rig"
        )
    group.add_argument(
        "--remap", action="append", default=[], metavar="OURS:=THEIRS", help="any other topic, as in ROS"
    )
    group.add_argument("--driver", metavar="NAME", help=f"preset of names: {', '.join(driver_names())}; or a file")
    group.add_argument(
        "--mounting",
        metavar="x,y,z,roll,pitch,yaw",
        default="",
        help="camera (x ahead, y left, z up) on base_link in m and rad, or a YAML file; else by /tf_static",
    )


def chosen_topics(arguments: argparse.Namespace) -> dict[str, str]:
    """Return what the user named: our topic -> the bag's. ValueError for words that are no pair."""
    chosen = {ours: getattr(arguments, name) for name, (ours, _) in OPTIONS.items() if getattr(arguments, name, None)}
    for option, separator in (("camera", "="), ("remap", ":=")):
        words = getattr(arguments, option, None)
        for word in words if isinstance(words, list) else ():
            ours, found, theirs = word.partition(separator)
            if not (found and ours and theirs):
                raise ValueError(f"--{option}: expected A{separator}B, found {word!r}")
            chosen[f"cameras/{ours}/image_raw" if option == "camera" else ours.lstrip("/")] = theirs
    return chosen


def choose_topics(bag: BagReader, arguments: argparse.Namespace) -> dict[str, str]:
    """Return what the user named, and what the driver that he named calls the rest."""
    chosen = chosen_topics(arguments)
    return driver_topics(bag, arguments.driver) | chosen if arguments.driver else chosen


def driver_topics(bag: BagReader, name: str) -> dict[str, str]:
    """Return the topics of a driver, below the one namespace where the bag has them; BagError: none, or several."""
    driver, have = read_driver(name), sorted(topic for topic, info in bag.topics.items() if info.count)
    roots = driver.roots(have)
    if not roots:
        missing = ", ".join(driver.missing(have))
        raise BagError(f"{bag.path}: driver {driver.name}: expected {missing}, found {', '.join(have) or 'none'}")
    if len(roots) > 1:
        cameras = ", ".join(f"/{root}" for root in roots)
        raise BagError(f"{bag.path}: driver {driver.name}: expected one camera, found {cameras}: name topics (--image)")
    return driver.find(have, roots[0])


def find_drivers(streams: Sequence[Stream]) -> list[Driver]:
    """Return the presets whose topics are all there under their usual names, those with registered depth first."""
    have = [stream.topic for stream in streams]
    drivers = [read_driver(name) for name in driver_names()]
    found = [driver for driver in drivers if driver.root and not driver.missing(have)]
    return sorted(found, key=lambda d: (INPUTS.index(d.input), "depth/camera_info" in d.topics, d.name))


def find_wanted(streams: Sequence[Stream], wanted: Iterable[str], chosen: dict[str, str]) -> dict[str, str]:
    """Return the bag's topic for each of ours: as the user named it, as a driver is known to, or as it is found."""
    wanted = tuple(wanted)
    if not chosen:
        have = [stream.topic for stream in streams if is_usable(stream)]
        named = (driver.find(have) for driver in find_drivers(streams) if set(wanted) <= set(driver.topics))
        chosen = {ours: topic for ours, topic in next(named, {}).items() if ours.split("/")[0] in _first_words(wanted)}
    return find_inputs(streams, wanted, chosen)


def _first_words(topics: Iterable[str]) -> set[str]:
    return {topic.split("/")[0] for topic in topics}


def find_topics(bag: BagReader, wanted: Iterable[str], chosen: dict[str, str]) -> dict[str, str]:
    """Return the bag's topic for every one of ours; odometry where there is any."""
    streams = read_streams(bag)
    with _name_bag(bag):
        return _beside_odometry(streams, find_wanted(streams, wanted, chosen))


def _beside_odometry(streams: Sequence[Stream], found: dict[str, str]) -> dict[str, str]:
    odometry = find_odometry(streams)
    return ({"odom": odometry} if odometry else {}) | found


def find_imu(bag: BagReader, chosen: Mapping[str, str]) -> dict[str, str]:
    """Return the topic of the IMU that the user named, or of one that /tf has on the vehicle; nothing without any."""
    if "imu" in chosen:
        return {"imu": absolute(chosen["imu"])}
    tree = read_frames(bag)
    offered = [s for s in read_streams(bag) if s.type == IMU and "gyro" not in s.topic]
    placed = [s for s in offered if tree.is_connected(BASE_FRAME, s.frame_id)] or offered
    best = min(placed, key=lambda s: "raw" in s.topic, default=None)
    return {} if best is None else {"imu": best.topic}


def names_of_cameras(views: Sequence[Stream]) -> list[str]:
    """Return a name for each of several cameras: the first part by which their topics differ, else all that differ."""
    parts = [view.base.strip("/").split("/") for view in views]
    differing = [place for place in range(min(map(len, parts))) if len({part[place] for part in parts}) > 1]
    for places in [*([place] for place in differing), differing]:
        names = ["_".join(part[place] for place in places) for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"camera{number}" for number in range(len(views))]


def nearest_pair_s(bag: BagReader, one: str, other: str) -> float:
    """Return by how many s the stamps of two topics differ at least, as far as the beginning of the bag tells."""
    stamps: dict[str, list[int]] = {one: [], other: []}
    nearest_ns = np.iinfo(np.int64).max
    for topic, _, message in bag.messages(stamps):
        stamp, partner = stamp_ns(message), stamps[other if topic == one else one]
        nearest_ns = min([nearest_ns, *(abs(stamp - there) for there in partner[-NUM_PAIRED:])])
        stamps[topic].append(stamp)
        if nearest_ns <= SLACK_S[0] * 1e9 or min(map(len, stamps.values())) >= NUM_PAIRED:
            break
    return float(nearest_ns * 1e-9)


def camera_names(chosen: Mapping[str, str]) -> list[str]:
    """Return the cameras of a rig that the user named, by --camera NAME=TOPIC, in his order."""
    return [ours.split("/")[1] for ours in chosen if ours.startswith("cameras/") and ours.endswith("/image_raw")]


def find_camera_topics(bag: BagReader, chosen: Mapping[str, str], *, has_lenses: bool) -> dict[str, str]:
    """Return the topics of several cameras that the user named, each with its calibration unless lenses are known.

    BagError, with the option to give, for a topic that is not there, or images without any calibration.
    """
    streams = read_streams(bag)
    by_name = {stream.topic: stream for stream in streams}
    with _name_bag(bag):
        found = find_inputs(streams, (), chosen)
        for name in () if has_lenses else camera_names(chosen):
            info = f"cameras/{name}/camera_info"
            if info not in found and f"cameras/{name}/sphere_info" not in found:
                image = by_name[found[f"cameras/{name}/image_raw"]]
                found[info] = info_of(image, streams, f"--remap {info}:=TOPIC").topic
    return _beside_odometry(streams, found)


def find_lens_topics(streams: Sequence[Stream], find: Callable[[Sequence[str]], dict[str, str]]) -> dict[str, str]:
    """Return the images of one camera and what tells its lens: camera_info, or the sphere_info of a panorama.

    `find` gives the topics that are wanted, as `find_wanted` does. BagError where there is no single camera.
    """
    spheres = [stream for stream in streams if stream.type == SPHERE_INFO]
    if not spheres:
        return find(("image_raw", "camera_info"))
    found = find(("image_raw",))
    if "camera_info" in found or "sphere_info" in found:
        return found
    image = next(stream for stream in streams if stream.topic == found["image_raw"])
    near = [info for info in spheres if info.frame_id == image.frame_id] or spheres
    same = [info for info in near if info.topic.rpartition("/")[0] == image.base.rpartition("/")[0]] or near
    return found | {"sphere_info": same[0].topic}


def find_localizer_topics(bag: BagReader, arguments: argparse.Namespace) -> dict[str, str]:
    """Return the bag's topic for each that a localiser hears; a bag with spheres has sphere_info for camera_info."""
    chosen, settings = choose_topics(bag, arguments), arguments.settings
    is_panorama = bool(settings.get("is_panorama"))
    if camera_names(chosen):
        has_lenses = is_panorama or bool(settings.get("rig.calibration"))
        return find_camera_topics(bag, chosen, has_lenses=has_lenses)
    if is_panorama:
        return find_topics(bag, ("image_raw",), chosen)
    streams = read_streams(bag)
    with _name_bag(bag):
        if settings.get("use_depth"):
            return _beside_odometry(streams, find_wanted(streams, RGBD, chosen))
        found = find_lens_topics(streams, lambda wanted: find_wanted(streams, wanted, chosen))
    return _beside_odometry(streams, found)


def note_mounting(bag: BagReader, image: str, arguments: argparse.Namespace) -> str:
    """Return the mounting to take, and say so where the bag does not tell it."""
    mounting = mounting_of(bag, image, arguments.settings)
    if mounting:
        base, text = BASE_FRAME, "the camera is taken as the vehicle; --mounting tells otherwise"
        logging.getLogger("sphere_nav.mounting").warning("%s: not above the camera on /tf_static: %s", base, text)
    return mounting


def odd_frame(bag: BagReader, found: dict[str, str]) -> str:
    """Return the frame of the images where their camera_info, found beside them, is of another one; else nothing."""
    frames = {stream.topic: stream.frame_id for stream in read_streams(bag)}
    image, info = (frames.get(absolute(found.get(name, name)), "") for name in ("image_raw", "camera_info"))
    if not (image and info) or image == info:
        return ""
    text = "camera_info is of frame %s, images are of frame %s: one camera by the names of the topics"
    logging.getLogger("sphere_nav.frames").warning(text, info, image)
    return image


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


def mounting_of(bag: BagReader, image: str, settings: dict[str, Any]) -> str:
    """Return no mounting where the bag tells it, else that the camera is the vehicle."""
    frame = next((s.frame_id for s in read_streams(bag) if s.topic == absolute(image)), "")
    base, frame = str(settings.get("base_frame", BASE_FRAME)), str(settings.get("camera_frame") or frame)
    return "" if not base or read_frames(bag).is_connected(base, frame) else CAMERA_IS_VEHICLE


def read_frames(bag: BagReader) -> TransformTree:
    """Return the frames of a bag: those that stand still, and as the first moving ones are."""
    tree = TransformTree()
    for topic, kind in ((TF_STATIC_TOPIC, True), (TF_TOPIC, False)):
        found = bag.messages([topic]) if topic in bag.topics else ()
        for _, _, message in islice(found, NUM_TF_MESSAGES):
            for transform in message.transforms:
                with suppress(ValueError):
                    tree.add(transform, is_static=kind)
    return tree


def pairing_slack(bag: BagReader, topic: str) -> float:
    """Return how far apart in s the stamps of one instant may be: a third of the period, as drivers jitter."""
    rate_hz = next(stream.rate_hz for stream in read_streams(bag) if stream.topic == absolute(topic))
    return float(np.clip(0.33 / max(rate_hz, 1e-3), *SLACK_S))


def guess_kind(bag: BagReader, chosen: dict[str, str], *, has_rig: bool) -> str:
    """Return what a bag with foreign topics is: rgbd, stereo, or cameras where a rig file is given."""
    if any(ours.startswith("cameras/") for ours in chosen) or has_rig:
        return "cameras"
    for kind, word in (("stereo", "left"), ("rgbd", "depth")):
        if any(ours.startswith(word) for ours in chosen):
            return kind
    streams, reasons = read_streams(bag), []
    if any(stream.type == SPHERE for stream in streams):
        return "sphere"
    for kind, topics in KINDS.items():
        try:
            find_wanted(streams, topics, chosen)
        except BagError as error:
            reasons.append(str(error).removeprefix("topics: "))
        else:
            return kind
    raise BagError(f"{bag.path}: topics: no spheres; {'; '.join(dict.fromkeys(reasons))}")


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
