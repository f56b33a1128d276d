"""One sphere out of a bag, a map or a pair of image files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.files.untrusted import read_npy
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps.reader import FILE_NAME, open_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav_tools.offline.importing.recording import read_meters, read_rgb
from sphere_nav_tools.offline.mapping.instants import collect
from sphere_nav_tools.offline.topic_finder import CAMERAS, TopicFinder


@dataclass(frozen=True)
class LensOptions:
    """How to read image files: fx, fy, cx, cy in pixels; the baseline in m of stereo pairs; depth units per m."""

    intrinsics: tuple[float, ...] | None = None
    baseline_m: float | None = None
    depth_units: float = 1000.0


Choose = Callable[[BagReader], TopicFinder]  # with the topics that the user named


def read_sphere(word: str, lens: LensOptions, params: MapperParams, choose: Choose = TopicFinder) -> Sphere:
    """Return the sphere that a word names: PATH:NUMBER, IMAGE,DEPTH or LEFT,RIGHT."""
    if "," in word:
        return _from_files(*_two(word), lens, params)
    path, separator, number = word.rpartition(":")
    if not separator or not number.isdigit():
        raise ValueError(f"{word}: expected PATH:NUMBER or two files with a comma between, found neither")
    if (Path(path) / FILE_NAME).is_file():
        with open_map(path) as reader:
            return reader.load_sphere(int(number))
    return sphere_of_bag(Path(path), int(number), choose)


def sphere_of_bag(path: Path, number: int, choose: Choose = TopicFinder) -> Sphere:
    """Return the sphere of the instant with this number, counted from 0."""
    with BagReader(path) as bag:
        finder, count = choose(bag), 0
        kind = finder.find_kind()
        if kind == CAMERAS:
            raise BagError(f"{path}: topics: expected spheres, RGB-D or stereo images, found the cameras of a rig")
        found = finder.require(finder.find(TOPICS[kind]))
        slack_s = finder.slack_s(found[TOPICS[kind][0]])
        node, spheres = collect(bag, {"input": kind, "slack_s": slack_s}, found)
        for count, sphere in enumerate(spheres, 1):
            if count > number:
                return cast("Sphere", sphere)
    reason = next((f" ({wanted.last_refusal})" for wanted in node.inputs if wanted.num_refused), "")
    raise BagError(f"{path}: expected instant {number}, found {count}{reason}")


def _from_files(first: Path, second: Path, lens: LensOptions, params: MapperParams) -> Sphere:
    if lens.intrinsics is None:
        raise ValueError("--camera: expected FX,FY,CX,CY for image files, found none")
    image = read_rgb(first)
    fx, fy, cx, cy = lens.intrinsics
    camera = Pinhole(image.shape[1], image.shape[0], fx, fy, cx, cy)
    if lens.baseline_m is not None:
        right = read_rgb(second)
        if right.shape[:2] != image.shape[:2]:
            raise ValueError(f"{second}: expected the size of {first}, found {right.shape[1]} x {right.shape[0]}")
        return sphere_from_stereo(
            image, right, camera, lens.baseline_m, T_BODY_OPTICAL, 0, params.stereo, params.partial
        )
    depth_m = _depth(second, lens.depth_units)
    if depth_m.shape != image.shape[:2]:
        raise ValueError(f"{second}: expected the size of {first}, found shape {depth_m.shape}")
    return sphere_from_rgbd(image, depth_m, camera, T_BODY_OPTICAL, 0, params.partial)


def _depth(path: Path, units: float) -> NDArray[np.floating]:
    if path.suffix == ".npy":
        return np.asarray(read_npy(path, "array of depths"), dtype=np.float32)
    return read_meters(path, units)


def _two(word: str) -> tuple[Path, Path]:
    names = word.split(",")
    if len(names) != 2 or not all(names):
        raise ValueError(f"{word}: expected two files with a comma between, found {len(names)}")
    return Path(names[0]), Path(names[1])
