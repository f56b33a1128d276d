"""Which topic of a bag is which of ours: a table of what can be wanted, and the options of every command that wants it.

`topic_finder` finds what the user does not name.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

from sphere_nav.ros.bags.streams import CAMERA_INFO, COMPRESSED, IMAGE, IMU, ODOMETRY, SPHERE, SPHERE_INFO, Stream
from sphere_nav.ros.bags.writer import absolute
from sphere_nav.ros.camera.drivers import driver_names
from sphere_nav.ros.camera.odometry_input import is_truth
from sphere_nav_tools.offline.settings import CollectAction, add

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
    "odom": Role("--odom", "odometry", (ODOMETRY,), lambda s: not is_truth(s.topic)),
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


SEPARATORS = {"--camera": "=", "--remap": ":="}  # of what two words in one name


def _read_topic(ours: str, option: str, word: str) -> dict[str, str]:
    """Return what the user names, our topic -> the bag's: none for an empty one. ValueError: words that are no pair."""
    theirs = word
    if option in SEPARATORS:
        ours, _, theirs = word.partition(SEPARATORS[option])
        if not (ours and theirs):
            raise ValueError(f"{option}: expected A{SEPARATORS[option]}B, found {word!r}")
        ours = f"cameras/{ours}/image_raw" if option == "--camera" else ours.lstrip("/")
        if not (role_of(ours).types or ours in OTHERS):
            known = ", ".join((*ROLES, "cameras/NAME/image_raw", *OTHERS))
            raise ValueError(f"{option}: expected one of our topics ({known}), found {ours!r}: nobody reads it")
    return {ours: theirs} if theirs else {}


def add_options(parser: argparse.ArgumentParser, *, has_cameras: bool = True) -> None:
    """Declare what every command that uses the topics of a bag takes; without --camera where that means a lens."""
    group = parser.add_argument_group("topics, found by type, name, frame and size where they are not given")
    options = [(role.option, ours, "TOPIC", role.meaning) for ours, role in ROLES.items() if " " not in role.option]
    options += [("--camera", "", "NAME=TOPIC", "images of a camera of a rig")] * has_cameras
    options += [("--remap", "", "OURS:=THEIRS", "any other topic, as in ROS")]
    for option, ours, metavar, meaning in options:
        read = partial(_read_topic, ours)
        add(group, option, metavar, meaning, action=CollectAction, const=read, dest="topics", default={})
    add(group, "--driver", "NAME", f"preset of names: {', '.join(driver_names())}; or a file")
    told = "camera (x ahead, y left, z up) on base_link in m and rad, or a YAML file; else by /tf_static"
    add(group, "--mounting", "x,y,z,roll,pitch,yaw", told, default="")


def options_of(topics: Mapping[str, str]) -> list[str]:
    """Return the options that name these topics, none for those with our own names."""
    words = []
    for ours, theirs in topics.items():
        if theirs != absolute(ours):
            option = role_of(ours).option
            words += ["--remap", f"{ours}:={theirs}"] if " " in option else [option, theirs]
    return words


def camera_names(topics: Iterable[str]) -> list[str]:
    """Return the cameras of a rig whose images are among our topics, in their order."""
    return [ours.split("/")[1] for ours in topics if ours.startswith("cameras/") and ours.endswith("/image_raw")]
