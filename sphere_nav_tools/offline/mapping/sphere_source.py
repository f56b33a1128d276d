"""One sphere out of a bag, a map or a pair of image files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import cast

import numpy as np

from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.files.untrusted import read_npy
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps.reader import FILE_NAME, open_map
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.importing.files import read_meters, read_rgb, require_size
from sphere_nav_tools.offline.mapping.stereo_drive import collect
from sphere_nav_tools.offline.topic_finder import CAMERAS, TopicFinder


def read_sphere(word: str, arguments: argparse.Namespace) -> Sphere:
    """Return the sphere that a word names: PATH:NUMBER, IMAGE,DEPTH or LEFT,RIGHT; `arguments` as of `register`."""
    first, comma, second = word.partition(",")
    if comma:
        return _from_files(Path(first), Path(second), arguments)
    path, separator, number = word.rpartition(":")
    if not separator or not number.isdigit():
        raise ValueError(f"{word}: expected PATH:NUMBER or two files with a comma between, found neither")
    if (Path(path) / FILE_NAME).is_file():
        with open_map(path) as reader:
            return reader.load_sphere(int(number))
    return _of_bag(Path(path), int(number), arguments)


def _of_bag(path: Path, number: int, arguments: argparse.Namespace) -> Sphere:
    """Return the sphere of the instant with this number, counted from 0."""
    with BagReader(path) as bag:
        finder, count = TopicFinder.of(bag, arguments), 0
        kind, choice = finder.find_source()
        if kind == CAMERAS:
            raise BagError(f"{path}: topics: expected spheres, RGB-D or stereo images, found the cameras of a rig")
        found = finder.odometry | choice.topics
        slack_s = finder.slack_s(found[TOPICS[kind][0]])
        node, spheres = collect(bag, {"input": kind, "slack_s": slack_s}, found)
        for count, (sphere, *_) in enumerate(spheres, 1):
            if count > number:
                return cast("Sphere", sphere)
    reason = next((f" ({wanted.last_refusal})" for wanted in node.inputs if wanted.num_refused), "")
    raise BagError(f"{path}: expected instant {number}, found {count}{reason}")


def _from_files(first: Path, second: Path, arguments: argparse.Namespace) -> Sphere:
    if arguments.camera is None:
        raise ValueError("--camera: expected FX,FY,CX,CY for image files, found none")
    image = read_rgb(first)
    camera = Pinhole(image.shape[1], image.shape[0], *arguments.camera)
    if arguments.baseline is not None:
        right = read_rgb(second)
        require_size(second, right, camera)
        return sphere_from_stereo(image, right, camera, arguments.baseline)
    if second.suffix == ".npy":
        depth_m = np.asarray(read_npy(second, "array of depths"), dtype=np.float32)
    else:
        depth_m = read_meters(second, arguments.depth_units)
    require_size(second, depth_m, camera)
    return sphere_from_rgbd(image, depth_m, camera)
