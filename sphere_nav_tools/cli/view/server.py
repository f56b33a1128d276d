"""The page: graph and key spheres in a browser, before what a camera would see; mouse and WASD move it.

The browser draws the graph and says where its camera is; for each browser a thread here draws the view from there and
sends it as the background. viser is imported when the page is made: a vehicle needs none.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Array, Bytes
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav.view_synthesis.constants import NUM_BLENDED
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav.view_synthesis.synthesis import SynthesizedView
from sphere_nav_tools.cli.gate import Address, WebPage, browser_pose

COLORS = {"way": (150, 150, 150), "loops": (220, 120, 30), "key": (40, 90, 160)}


MAX_SIDE, MOVING_SIDE = 800, 480  # px, of a view, and of one while the camera moves; the browser enlarges it
NUM_FILLING, STILL_S = 4, 0.3  # key spheres of a view once the camera stands, and when it does
BELOW = np.array([0.0, 0.0, -0.4])  # m by which the graph is drawn lower: on its lines one would see nothing else
KEYS = "**W A S D** move, **Q E** down and up, mouse turns, wheel nears; a click on a key sphere goes there."
ANY_LOOK = "the nearest key spheres"


class Page(WebPage):
    """Serves one map to any number of browsers until `close`."""

    def __init__(
        self,
        address: Address,
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
        scene = self.server.scene
        for name, ends in edges_of(self._graph).items():
            scene.add_line_segments(f"/graph/{name}", points=(ends + BELOW).astype(np.float32), colors=COLORS[name])
        for node in self._graph:
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
            T, chosen = browser_pose(client.camera), looks[look.value]
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


def edges_of(graph: SphereGraph) -> dict[str, Array]:
    """Return the ends (N, 2, 3) of the edges along the way, and of the loops; neither where there is none."""
    found: dict[str, list[list[Array]]] = {}
    for edge in graph.edges:
        ends = [graph[end].T_map_sphere.translation for end in (edge.a, edge.b)]
        found.setdefault("loops" if edge.is_loop else "way", []).append(ends)
    return {name: np.array(ends) for name, ends in found.items()}


def put(client: Any, T_map_camera: SE3) -> None:
    """Move the camera of a browser at once."""
    with client.atomic():
        client.camera.position = T_map_camera.translation
        client.camera.look_at = look_at(T_map_camera)


def whereabouts(graph: SphereGraph, T_map_camera: SE3) -> str:
    """Return where a camera is, in words."""
    (node,), (x, y, z) = graph.nearest(T_map_camera.translation), T_map_camera.translation
    ahead = T_map_camera.rotation[:, 2]
    heading, away = np.degrees(np.arctan2(ahead[1], ahead[0])), T_map_camera.distance(node.T_map_sphere)[0]
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


def encoded(image: Bytes, suffix: str) -> bytes:
    """Return an RGB picture as a file of a kind that OpenCV knows."""
    return bytes(cv2.imencode(suffix, image[..., ::-1])[1].tobytes())
