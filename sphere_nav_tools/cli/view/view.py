"""`sphere_nav view`: look around in a map, in a web browser."""

from __future__ import annotations

import argparse
import threading
from contextlib import closing
from pathlib import Path

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.graph import Experience
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav_tools.cli import gate
from sphere_nav_tools.cli.view.server import NUM_FILLING, Page, centred_camera, encoded, shown
from sphere_nav_tools.offline.settings import (
    FileAction,
    add,
    add_overwrite,
    floats,
    read_size,
)

HELP = """\
Show a map in a web browser: its graph, its key spheres, and what a camera would see from anywhere near them. The mouse
turns and zooms, W A S D Q E move, a click on a key sphere flies there. A map of many days is shown in
the experience that is chosen on the page, or by --experience.

With --screenshot a single view is written, without a browser. Poses are those of the vehicle's axes: x ahead, z up.

examples:
  sphere_nav view kitchen
  sphere_nav view kitchen --screenshot view.png --pose 1.0,0.2,1.5,90
  sphere_nav view day_and_night --experience night --screenshot night.png
  sphere_nav view kitchen --host 0.0.0.0 --port 9000
"""
FOCAL = 0.65  # of a single view, in widths of the image: 75 deg wide


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "map made by `sphere_nav map`", Path)
    gate.add_options(parser, "view")
    expected = "x,y,z,yaw[,pitch,roll]"
    begin = parser.add_mutually_exclusive_group()
    add(begin, "--pose", expected, "where to begin, m and degrees", floats(expected, 4, 6))
    add(begin, "--sphere", "ID", "begin at a key sphere (the first one)", int)
    add(parser, "--experience", "NAME", "begin with this look of the map, as map-info names it")
    told = "write the first view (.png, .jpg) and end"
    add(parser, "--screenshot", "F", told, Path, action=FileAction, const=(".png", ".jpg"))
    add(parser, "--size", "WxH", "of that view (%(default)s)", read_size, default="800x600")
    add_overwrite(parser)


def run(arguments: argparse.Namespace) -> None:
    """Write one view, or serve until interrupted."""
    with open_map(arguments.map) as reader:
        start = first_pose(reader, arguments)
        with closing(Scene(reader)) as scene:
            experience = find_experience(scene, arguments.experience)
            if arguments.screenshot:
                write_view(scene, start, experience, arguments)
            else:
                address = gate.address_of("view", arguments)
                with closing(Page(address, reader.graph, scene, start, experience)) as page:
                    print(f"{page.url}  (Ctrl-C ends it)", flush=True)
                    threading.Event().wait()


def first_pose(reader: MapReader, arguments: argparse.Namespace) -> SE3:
    """Return the pose of the camera to begin with, optical axes."""
    if not arguments.pose:
        sphere_id = arguments.sphere if arguments.sphere is not None else min(reader.graph.nodes)
        return reader.graph[sphere_id].T_map_sphere @ T_BODY_OPTICAL
    yaw, pitch, roll = np.radians([*arguments.pose[3:], 0.0, 0.0][:3])
    return SE3.from_angles(roll, pitch, yaw, arguments.pose[:3]) @ T_BODY_OPTICAL


def find_experience(scene: Scene, name: str | None) -> Experience | None:
    """Return the experience of a name or drive; None for none. ValueError where the map has no such one."""
    if not name:
        return None
    known = {str(one): one for one in reversed(scene.experiences)}
    if name not in known:
        raise ValueError(f"--experience: expected one of {', '.join(map(repr, known))}, found {name!r}")
    return known[name]


def write_view(scene: Scene, T_map_camera: SE3, experience: Experience | None, arguments: argparse.Namespace) -> None:
    """Write the view from a pose as a picture."""
    output: Path = arguments.screenshot
    width, height = arguments.size
    camera = centred_camera(width, height, FOCAL * width)
    view = scene.render(T_map_camera, camera, experience, count=NUM_FILLING)
    output.write_bytes(encoded(shown(view), output.suffix))
    print(f"{output}: {view.image.shape[1]} x {view.image.shape[0]}, {100 * view.is_known.mean():.1f} % seen")
