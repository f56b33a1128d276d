"""Every node with what it takes to make it work: parameters, and inputs of now."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from std_msgs.msg import String

from cycab_sim.params import CameraRigParams
from cycab_sim.ros.node import CycabSim
from cycab_sim.sensors.cameras import make_rig
from dense_localizer.ros.node import DenseLocalizerNode
from mcl_depth.ros.node import MclDepthNode
from path_follower.ros.guard_node import CommandGuard
from path_follower.ros.navigator_node import RouteNavigator
from path_follower.ros.node import PathFollowerNode
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Curve
from path_follower.routes.network_file import write_network
from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_mapping.ros.node import SphereMapper
from sphere_nav.geometry import Pinhole, Rig, Spherical
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags.player_node import BagPlayer
from sphere_nav.ros.bags.recorder_node import BagRecorder
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, sphere_to_message
from sphere_nav.spheres.sphere import Sphere

CAMERA = Pinhole(16, 12, 10.0, 10.0, 7.5, 5.5)
RNG = np.random.default_rng(0)
PIXELS = RNG.integers(20, 230, (12, 16)).astype(np.uint8)
LEVELS = RNG.integers(20, 230, (64, 128, 3)).astype(np.uint8)
SPHERE = Sphere(LEVELS, np.full((64, 128), 5.0, np.float32), Spherical(128, 64))


class Case(NamedTuple):
    """A node, its parameters with files in a folder, and what to send it."""

    node_class: Any
    values: Callable[[Path], dict[str, Any]] = lambda folder: {}
    sends: Callable[[], dict[str, Any]] = dict


def _view() -> dict[str, Any]:
    stamp = time.time_ns()
    image = array_to_image(PIXELS, stamp, "base_link", "mono8")
    return {"camera_info": camera_to_info(CAMERA, stamp, "base_link"), "image_raw": image}


@cache
def _rig() -> Rig:
    made = make_rig(CameraRigParams(kind="vertical", size="160,160"), 0)
    assert made is not None
    return made


def pictures() -> dict[str, Any]:
    """Return an image of now of each camera of the rig: of one grey, where no feature can contradict the lenses."""
    stamp, found = time.time_ns(), {}
    for part in _rig().cameras:
        gray = np.full((part.camera.height, part.camera.width), 128, np.uint8)
        found[f"cameras/{part.name}/image_raw"] = array_to_image(gray, stamp, part.name, "mono8")
    return found


def _bag_in(folder: Path) -> dict[str, Any]:
    if not (folder / "bag").exists():
        with BagWriter(folder / "bag") as bag:
            for number in range(20_000):  # for hours
                bag.write("text", String(data=str(number)), number * 1_000_000_000)
    return {"bag": str(folder / "bag")}


def rig_in(folder: Path) -> dict[str, Any]:
    """Return the parameters of a stitcher."""
    if not (folder / "rig.yaml").exists():
        write_rig(folder / "rig.yaml", _rig())
    return {"rig": str(folder / "rig.yaml"), "stitch.width": 128}


def _routes_in(folder: Path) -> dict[str, Any]:
    if not (folder / "routes.geojson").exists():
        x = np.linspace(0.0, 20.0, 201)
        write_network(folder / "routes.geojson", build_network([TaughtDrive(Curve(x, 0 * x, 0 * x, 0 * x + 1.0))]))
    return {"network": str(folder / "routes.geojson")}


CASES = (
    Case(DenseLocalizerNode, sends=_view),
    Case(MclDepthNode, sends=_view),
    Case(PathFollowerNode),
    Case(RouteNavigator, _routes_in),
    Case(CommandGuard),
    Case(BagPlayer, _bag_in),
    Case(
        BagRecorder,
        lambda folder: {"topics": "text", "output": str(folder / str(len(list(folder.iterdir()))))},
        lambda: {"text": String(data="hello")},
    ),
    Case(
        SphereMapper,
        lambda folder: {"map_folder": str(folder / "maps")},
        lambda: {"sphere": sphere_to_message(replace(SPHERE, stamp_ns=time.time_ns()), "sphere_link")},
    ),
    Case(SphereStitcher, rig_in, pictures),
    Case(CycabSim, lambda folder: {"world": "corridor", "camera.period": 0.0}),
)
