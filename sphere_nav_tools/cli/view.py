"""`sphere_nav view`: look around in a map, in a web browser (M15 section 6.3.2).

The browser draws the graph and says where its camera is; mouse and WASD move it. For each browser a thread here draws
what a camera would see from there and sends it as the background.
"""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Array, Bytes
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav.view_synthesis.constants import NUM_BLENDED
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav.view_synthesis.synthesis import SynthesizedView
from sphere_nav_tools.cli import gate
from sphere_nav_tools.offline.settings import FileAction, add, add_overwrite, floats, read_size

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
COLORS = {"way": (150, 150, 150), "loops": (220, 120, 30), "key": (40, 90, 160)}
MAX_SIDE, MOVING_SIDE = 800, 480  # px, of a view, and of one while the camera moves; the browser enlarges it
NUM_FILLING, STILL_S = 4, 0.3  # key spheres of a view once the camera stands, and when it does
BELOW = np.array([0.0, 0.0, -0.4])  # m by which the graph is drawn lower: on its lines one would see nothing else
KEYS = "**W A S D** move, **Q E** down and up, mouse turns, wheel nears; a click on a key sphere goes there."
ANY_LOOK = "the nearest key spheres"


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
    output.write_bytes(cv2.imencode(output.suffix, shown(view)[..., ::-1])[1])
    print(f"{output}: {view.image.shape[1]} x {view.image.shape[0]}, {100 * view.is_known.mean():.1f} % seen")


class Page(gate.WebPage):
    """Serves one map to any number of browsers until `close`."""

    def __init__(
        self,
        address: gate.Address,
        graph: SphereGraph,
        scene: Scene,
        start: SE3,
        experience: Experience | None = None,
    ) -> None:
        """`experience`: the look of the map that browsers are shown first; None: the nearest key spheres of any."""
        self._first, self._start = experience, start
        self._graph, self._scene = graph, scene
        super().__init__(address)
        initial = self.server.initial_camera
        initial.position, initial.look_at, initial.up = start.translation, look_at(start), (0.0, 0.0, 1.0)
        initial.near, initial.far = 0.05, 500.0
        self._add_graph()
        self.server.on_client_connect(self._welcome)

    def _add_graph(self) -> None:
        graph, scene = self._graph, self.server.scene
        for name, is_loop in (("way", False), ("loops", True)):
            edges = [(graph[edge.a], graph[edge.b]) for edge in graph.edges if edge.is_loop == is_loop]
            ends = [[node.T_map_sphere.translation + BELOW for node in pair] for pair in edges]
            if ends:
                scene.add_line_segments(f"/graph/{name}", points=np.array(ends, np.float32), colors=COLORS[name])
        for node in graph:
            handle = scene.add_icosphere(
                f"/graph/key_sphere_{node.id}",
                radius=0.08,
                color=COLORS["key"],
                position=node.T_map_sphere.translation + BELOW,
            )
            handle.on_click(lambda event, T=node.T_map_sphere: put(event.client, T @ T_BODY_OPTICAL))

    def _welcome(self, client: Any) -> None:
        """Set a new browser up, with a thread that draws for it."""
        changed = threading.Event()
        client.camera.on_update(lambda _: changed.set())
        client.gui.add_markdown(KEYS)
        looks = {ANY_LOOK: None} | {str(one): one for one in self._scene.experiences}
        look = client.gui.add_dropdown("experience", tuple(looks), str(self._first or ANY_LOOK))
        look.visible = len(looks) > 2
        look.on_update(lambda _: changed.set())
        text = client.gui.add_markdown("")
        client.gui.add_button("back to the start").on_click(lambda _: put(client, self._start))

        def draw(is_still: bool) -> bool:
            """Draw a small view while the camera moves, its holes filled when it stands; whether it is whole."""
            T, chosen = gate.browser_pose(client.camera), looks[look.value]
            count, side = (NUM_FILLING, MAX_SIDE) if is_still else (NUM_BLENDED, MOVING_SIDE)
            is_whole, lens = self._scene.is_ready(T, chosen, count), browser_camera(client.camera, side)
            view = self._scene.render(T, lens, chosen, is_waiting=False, count=count)
            client.scene.set_background_image(shown(view), format="jpeg", jpeg_quality=85)
            text.content = f"{whereabouts(self._graph, T)}\n\n{100 * view.is_known.mean():.0f} % seen"
            return is_whole

        changed.set()
        threading.Thread(target=self._follow, args=(client, changed, draw), daemon=True).start()

    def _follow(self, client: Any, changed: threading.Event, draw: Callable[[bool], bool]) -> None:
        """Draw whenever the camera of a browser has moved, and once more when it stands, until it leaves."""
        is_whole = True
        while self.has(client):
            if changed.wait(STILL_S):
                changed.clear()
                draw(False)
                is_whole = False
            elif not is_whole:
                is_whole = draw(True)  # else what is on its way will be there


def put(client: Any, T_map_camera: SE3) -> None:
    """Move the camera of a browser at once."""
    with client.atomic():
        client.camera.position = T_map_camera.translation
        client.camera.look_at = look_at(T_map_camera)


def whereabouts(graph: SphereGraph, T_map_camera: SE3) -> str:
    """Return where a camera is, in words."""
    (node,), (x, y, z) = graph.nearest(T_map_camera.translation), T_map_camera.translation
    heading = np.degrees((T_map_camera @ T_BODY_OPTICAL.inverse()).yaw)
    away = T_map_camera.distance(node.T_map_sphere)[0]
    return f"x {x:.1f}, y {y:.1f}, z {z:.1f} m, looks {heading:.0f} deg; {away:.1f} m from key sphere {node.id}"


def look_at(T_map_camera: SE3) -> Array:
    """Return the point (3,) in front of a camera about which the mouse turns it."""
    return T_map_camera.translation + T_map_camera.rotation[:, 2]


def browser_camera(camera: Any, side: int = MAX_SIDE) -> Pinhole:
    """Return the lens of a browser's camera; views are no larger than `side`."""
    aspect = float(camera.aspect)
    width = round(side * min(aspect, 1.0))
    height = max(round(width / aspect), 1)
    return centred_camera(width, height, 0.5 * height / np.tan(0.5 * float(camera.fov)))


def centred_camera(width: int, height: int, focal: float) -> Pinhole:
    """Return the camera whose axis goes through the middle of its image."""
    return Pinhole(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))


def shown(view: SynthesizedView) -> Bytes:
    """Return the picture of a view, its holes dark."""
    image = view.image.copy()
    image[~view.is_known] = 60
    return image
