"""`sphere_nav register`: the motion between two spheres, RGB-D images or stereo pairs, as JSON."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_mapping.graph.both_ways import FEATURES, ONE_WAY, find_motion, why_denied
from sphere_mapping.graph.registration import PreparedSphere, align_sphere, guess_by_rotation
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import read_npy
from sphere_nav.photometric import Alignment
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps.reader import FILE_NAME, open_map
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.importing.files import read_meters, read_rgb, require_size
from sphere_nav_tools.offline.mapping.stereo_drive import collect
from sphere_nav_tools.offline.settings import add, floats, read_pose, read_positive
from sphere_nav_tools.offline.tables import REMEDY
from sphere_nav_tools.offline.topic_finder import CAMERAS, TopicFinder

HELP = """\
Align B with A and print the pose of B in A as JSON: T_a_b, covariance of (v, omega) in T_a_b @ exp(xi), residual.

A and B are PATH:NUMBER, an instant of a bag (spheres, RGB-D or stereo; counted from 0) or a key sphere of a map; or
two files IMAGE,DEPTH (16 bit, or .npy in m) or LEFT,RIGHT (rectified, with --baseline). Axes of the result: x forward,
y left, z up. The motion may be large: features with range give the first guess, and aligning A with B must agree with
aligning B with A. Exit status 1 where the alignment is refused; the JSON and one line say why and what would help.

examples:
  sphere_nav register kitchen:0 kitchen:10
  sphere_nav register recording:0 recording:10 --driver realsense
  sphere_nav register color0.png,depth0.png color9.png,depth9.png --camera 525,525,319.5,239.5 --depth-units 5000
  sphere_nav register l0.png,r0.png l1.png,r1.png --camera 707.09,707.09,601.89,183.11 --baseline 0.537
"""
RESIDUAL = ("mad", "ncc", "overlap", "inlier_share", "num_pixels")  # how well the images agree


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "a", "A", "reference, with range")
    add(parser, "b", "B", "what is aligned with it")
    add(parser, "--camera", "FX,FY,CX,CY", "px, of image files", floats("FX,FY,CX,CY", 4))
    add(parser, "--baseline", "M", "m; the files are rectified stereo pairs", read_positive)
    add(parser, "--depth-units", "N", "depth units per m (%(default)s)", float, default=1000.0)
    add(parser, "--guess", "x,y,z,qx,qy,qz,qw", "first guess of T_a_b (identity)", read_pose, default=SE3.identity())
    topics.add_options(parser, has_cameras=False)


def run(arguments: argparse.Namespace) -> int:
    """Read both, align, print."""
    a, b = (read_sphere(word, arguments) for word in (arguments.a, arguments.b))
    found = register_spheres(a, b, arguments.guess)
    print(json.dumps(found.values(), indent=2))
    if not found.is_converged:
        print(f"sphere_nav register: {arguments.b}: {describe_refusal(found.reason)}", file=sys.stderr)
    return 0 if found.is_converged else 1


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


@dataclass(frozen=True, eq=False)
class Registration:
    """The motion between two spheres.

    covariance (6, 6), m and rad, is that of xi = (v, omega) in T_a_b @ exp(xi). Where `is_converged` is false, `reason`
    says why, and the pose is the best that was found.
    """

    T_a_b: SE3
    covariance: Array
    is_converged: bool
    reason: str
    alignment: Alignment

    def values(self) -> dict[str, Any]:
        """Return all as plain values, for JSON."""
        return {
            "is_converged": self.is_converged,
            "reason": self.reason,
            "T_a_b": {
                "translation_m": self.T_a_b.translation.tolist(),
                "quaternion_xyzw": self.T_a_b.quaternion.tolist(),
                "matrix": self.T_a_b.matrix.tolist(),
                "angle_deg": float(np.degrees(SE3.identity().distance(self.T_a_b)[1])),
            },
            "covariance": finite(self.covariance),
            "residual": {name: getattr(self.alignment, name) for name in RESIDUAL},
            "iterations": self.alignment.iterations,
            "gain": self.alignment.gains[0],
            "bias": self.alignment.biases[0],
        }


def register_spheres(a: Sphere, b: Sphere, T_a_b_guess: SE3) -> Registration:
    """Return the alignment of b with a.

    The motion may be any: features with range give the first guess, the one given and none at all come after it. What
    the way back or features contradict is not converged.
    """
    reference, current = (PreparedSphere(sphere) for sphere in (a, b))

    proven = find_motion(reference, current) if b.measured.any() else None
    if proven is not None:
        found = replace(proven.forward, T_world_camera=proven.T_a_b, covariance=proven.covariance)
    else:
        guesses = T_a_b_guess, guess_by_rotation(current, reference, SE3.identity())
        check = partial(why_denied, reference, current, is_expected=False)
        found = align_sphere(current, [reference.at(SE3.identity())], guesses, check)
    return Registration(found.T_world_camera, found.covariance, found.is_converged, found.reason, found)


def describe_refusal(reason: str) -> str:
    """Return one line on why an alignment was refused, and what would help."""
    words = {ONE_WAY: "the way back disagrees", FEATURES: "features agree on another motion"}
    why = f"refused ({reason}): {words[reason]}" if reason in words else f"refused ({reason})"
    return f"{why}; {REMEDY}, or a first guess (--guess, by odometry), would help"


def finite(matrix: np.ndarray) -> list[list[float | None]]:
    """Return a matrix for JSON, which has no infinity."""
    return [[float(value) if np.isfinite(value) else None for value in row] for row in matrix]
