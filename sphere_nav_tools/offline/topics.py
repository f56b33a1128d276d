"""Which topic of a bag is which of ours: a table of what can be wanted, and the options of every command that wants it.

`topic_finder` finds what the user does not name.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from sphere_nav.ros.bags.streams import CAMERA_INFO, COMPRESSED, IMAGE, IMU, ODOMETRY, SPHERE, SPHERE_INFO, Stream
from sphere_nav.ros.bags.writer import absolute
from sphere_nav.ros.camera.drivers import driver_names
from sphere_nav.ros.camera.odometry_input import TRUTH_WORDS

PICTURES = (IMAGE, COMPRESSED)
DEPTH = "depth/image_raw"
BASE_FRAME, TF_TOPIC, TF_STATIC_TOPIC = "base_link", "/tf", "/tf_static"


@dataclass(frozen=True)
class Role:
    """What a topic can be to us: the option that names it, what it holds, its types, and what it must show beside."""

    option: str
    meaning: str
    types: tuple[str, ...]
    fits: Callable[[Stream], bool] = lambda stream: True


ROLES = {
    "image_raw": Role("--image", "images", PICTURES, lambda s: s.is_picture),
    "camera_info": Role("--info", "calibration of the images", (CAMERA_INFO,)),
    DEPTH: Role("--depth", "depth images", PICTURES, lambda s: s.is_depth),
    "depth/camera_info": Role("--depth-info", "calibration of depth not registered to the images", (CAMERA_INFO,)),
    "left/image_raw": Role("--left", "images of a left camera", PICTURES, lambda s: s.is_picture),
    "left/camera_info": Role("--left-info", "its calibration", (CAMERA_INFO,)),
    "right/image_raw": Role("--right", "images of the right camera beside it", PICTURES, lambda s: s.is_picture),
    "right/camera_info": Role("--right-info", "its calibration", (CAMERA_INFO,)),
    "odom": Role("--odom", "odometry", (ODOMETRY,), lambda s: not any(word in s.topic for word in TRUTH_WORDS)),
    "imu": Role("--imu", "inertial measurements", (IMU,), lambda s: "gyro" not in s.topic),
    "sphere": Role("--remap sphere:=TOPIC", "spheres", (SPHERE,)),
    "sphere_info": Role("--remap sphere_info:=TOPIC", "lens of panoramas", (SPHERE_INFO,)),
}


OTHERS = ("tf", "tf_static", "initialpose", "other/pose", "reference_path", "points", "cloud")  # of some node, too


def role_of(ours: str) -> Role:
    """Return what a topic of ours is; those of the cameras of a rig by their name, and one of no type for all else."""
    name, _, kind = ours.removeprefix("cameras/").rpartition("/")
    if not ours.startswith("cameras/") or kind not in ROLES:
        return ROLES.get(ours, Role(f"--remap {ours}:=TOPIC", ours, ()))
    if kind != "image_raw":
        return Role(f"--remap {ours}:=TOPIC", f"{kind} of camera {name}", ROLES[kind].types)
    option, meaning = f"--camera {name}=TOPIC", f"images of camera {name}"
    return Role(option, meaning, PICTURES, lambda s: s.is_picture and name in words(s))


def words(stream: Stream) -> set[str]:
    """Return the parts of a topic, and those of each between underscores."""
    return {*stream.base.split("/"), *stream.base.replace("_", "/").split("/")}


def add_options(parser: argparse.ArgumentParser, *, has_cameras: bool = True) -> None:
    """Declare what every command that uses the topics of a bag takes; without --camera where that means a lens."""
    group = parser.add_argument_group("topics, found by type, name, frame and size where they are not given")
    for option, ours in _plain_options().items():
        group.add_argument(option, metavar="TOPIC", help=ROLES[ours].meaning)
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
    given = vars(arguments)
    named = {ours: given.get(option.removeprefix("--").replace("-", "_")) for option, ours in _plain_options().items()}
    chosen = {ours: topic for ours, topic in named.items() if topic}
    for option, separator in (("camera", "="), ("remap", ":=")):
        words = given.get(option)
        for word in words if isinstance(words, list) else ():
            ours, found, theirs = word.partition(separator)
            if not (found and ours and theirs):
                raise ValueError(f"--{option}: expected A{separator}B, found {word!r}")
            ours = f"cameras/{ours}/image_raw" if option == "camera" else ours.lstrip("/")
            if not (role_of(ours).types or ours in OTHERS):
                known = ", ".join((*ROLES, "cameras/NAME/image_raw", *OTHERS))
                raise ValueError(f"--{option}: expected one of our topics ({known}), found {ours!r}: nobody reads it")
            chosen[ours] = theirs
    return chosen


def options_of(topics: Mapping[str, str]) -> list[str]:
    """Return the options that name these topics, none for those with our own names."""
    words, by_topic = [], {ours: option for option, ours in _plain_options().items()}
    for ours, theirs in topics.items():
        if theirs != absolute(ours):
            words += [by_topic[ours], theirs] if ours in by_topic else ["--remap", f"{ours}:={theirs}"]
    return words


def camera_names(topics: Iterable[str]) -> list[str]:
    """Return the cameras of a rig whose images are among our topics, in their order."""
    return [ours.split("/")[1] for ours in topics if ours.startswith("cameras/") and ours.endswith("/image_raw")]


def _plain_options() -> dict[str, str]:
    return {role.option: ours for ours, role in ROLES.items() if " " not in role.option}
