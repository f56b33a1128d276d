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

from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.judge.residual import residual_image
from sphere_nav.geometry import SE3, Camera, Pinhole
from sphere_nav.geometry.arrays import Array, Bytes
from sphere_nav.localization.status import Status
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, to_gray_bytes, to_rgb
from sphere_nav.view_synthesis.constants import NUM_BLENDED
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav.view_synthesis.synthesis import SynthesizedView
from sphere_nav_tools.cli.gate import Address, WebPage, browser_pose
from sphere_nav_tools.cli.operate.words import round_length

MIN_EXTENT_M, MARGIN = 10.0, 1.15  # of what the small map shows: at least; as many times the extent of the graph
COLORS = {"way": (150, 150, 150), "loops": (220, 120, 30), "key": (40, 90, 160), "camera": (200, 30, 30)}


class Minimap:
    """A graph as a picture (SVG), drawn once, and a pose in it; units are m of the map, x to the right, y up."""

    def __init__(self, graph: SphereGraph) -> None:
        places = {node.id: node.T_map_sphere.translation[:2] for node in graph}
        low, high = np.min([*places.values()], axis=0), np.max([*places.values()], axis=0)
        side = MARGIN * max(float((high - low).max()), MIN_EXTENT_M)
        (x, y), self._thin = 0.5 * (low + high) - 0.5 * side, 0.005 * side
        bar = round_length(0.4 * side)
        paths = (
            f'<path d="{"".join(f"M{a} {b}L{c} {d}" for (a, b, _), (c, d, _) in ends)}" stroke="rgb{COLORS[name]}"/>'
            for name, ends in edges_of(graph).items()
        )
        dots = (f'<circle cx="{a}" cy="{b}" r="{self._thin}" fill="rgb{COLORS["key"]}"/>' for a, b in places.values())
        self._head = (
            f'<svg viewBox="{x} {-y - side} {side} {side}" stroke-width="{self._thin}" style="background:white">'
            f'<text x="{x}" y="{-y - 3 * self._thin}" font-size="{8 * self._thin}">{bar:g} m</text>'
            f'<g transform="scale(1 -1)"><path d="M{x} {y}h{bar}" stroke="black"/>{"".join([*paths, *dots])}'
        )

    def draw(self, T_map_camera: SE3) -> str:
        """Return the picture with an arrow that points to where a camera (z forward) looks."""
        (x, y), (dx, dy) = T_map_camera.translation[:2], T_map_camera.rotation[:2, 2]
        move = f"translate({x} {y}) rotate({np.degrees(np.arctan2(dy, dx)):.1f}) scale({4 * self._thin})"
        return f'{self._head}<path d="M3 0L-1 1.2L-1 -1.2Z" transform="{move}" fill="rgb{COLORS["camera"]}"/></g></svg>'


MAX_SIDE, MOVING_SIDE = 800, 480  # px, of a view, and of one while the camera moves; the browser enlarges it
NUM_FILLING, STILL_S = 4, 0.3  # key spheres of a view once the camera stands, and when it does
BELOW = np.array([0.0, 0.0, -0.4])  # m by which the graph is drawn lower: on its lines one would see nothing else
PAUSE_S = 0.1  # between two looks at whether a pause is over
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
        self._graph, self._scene, self._minimap = graph, scene, Minimap(graph)
        super().__init__(address)
        initial = self.server.initial_camera
        initial.position, initial.look_at, initial.up = start.translation, look_at(start), (0.0, 0.0, 1.0)
        initial.near, initial.far = 0.05, 500.0
        self._add_graph()
        self._drive: dict[str, Any] = {}
        self.server.on_client_connect(self._welcome)

    def show(self, stamp_ns: int, image: Bytes, estimate: CameraEstimate, camera: Camera) -> None:
        """Show one image of a drive: the camera in the map, image, residual, status; wait while it is paused."""
        gui, T_map_camera, shot = self.server.gui, estimate.T_map_camera, to_rgb(image)
        residual = np.zeros(image.shape[:2], np.uint8)
        if estimate.candidate is not None:
            residual = residual_image(to_gray_bytes(image), camera, estimate.candidate)
        picture, text = np.vstack([shot, to_rgb(residual)]), describe(estimate.status, stamp_ns)
        if not self._drive:
            self._drive = {
                "pause": gui.add_checkbox("pause the drive", False),
                "ride": gui.add_checkbox("ride along", False),
                "text": gui.add_markdown(text),
                "picture": gui.add_image(picture, label="camera, residual (grey: as the map)"),
            }
        self._drive["text"].content, self._drive["picture"].image = text, picture
        if T_map_camera is not None:
            x, y, z, w = T_map_camera.quaternion
            self.server.scene.add_camera_frustum(
                "/drive",
                fov=2.0 * float(np.arctan(0.5 * camera.height / camera.pixels_per_radian)),
                aspect=camera.width / camera.height,
                scale=0.3,
                color=COLORS["camera"],
                wxyz=(w, x, y, z),
                position=T_map_camera.translation,
            )
            for client in self.server.get_clients().values() if self._drive["ride"].value else ():
                put(client, T_map_camera)
        while self._drive["pause"].value and not self.closed.wait(PAUSE_S):
            pass

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
        target = client.gui.add_number("key sphere", 0, min=0, max=max(self._graph.nodes), step=1)
        client.gui.add_button("go there").on_click(lambda _: go_to(int(target.value)))
        looks = {ANY_LOOK: None} | {str(one): one for one in self._scene.experiences}
        look = client.gui.add_dropdown("experience", tuple(looks), str(self._first or ANY_LOOK))
        look.visible = len(looks) > 2
        look.on_update(lambda _: changed.set())
        text = client.gui.add_markdown("")
        minimap = client.gui.add_html(self._minimap.draw(browser_pose(client.camera)))
        client.gui.add_button("back to the start").on_click(lambda _: put(client, self._start))
        shot = client.gui.add_button("screenshot")

        def go_to(sphere_id: int) -> None:
            if sphere_id in self._graph.nodes:
                put(client, self._graph[sphere_id].T_map_sphere @ T_BODY_OPTICAL)

        def draw(is_still: bool) -> bool:
            """Draw a small view while the camera moves, its holes filled when it stands; whether it is whole."""
            T, chosen = browser_pose(client.camera), looks[look.value]
            minimap.content = self._minimap.draw(T)
            count, side = (NUM_FILLING, MAX_SIDE) if is_still else (NUM_BLENDED, MOVING_SIDE)
            is_whole, lens = self._scene.is_ready(T, chosen, count), browser_camera(client.camera, side)
            view = self._scene.render(T, lens, chosen, is_waiting=False, count=count)
            client.scene.set_background_image(shown(view), format="jpeg", jpeg_quality=85)
            text.content = f"{whereabouts(self._graph, T)}\n\n{100 * view.is_known.mean():.0f} % seen"
            return is_whole

        def send_screenshot(_: Any) -> None:
            lens = browser_camera(client.camera)
            view = self._scene.render(browser_pose(client.camera), lens, looks[look.value], count=NUM_FILLING)
            client.send_file_download("view.png", encoded(shown(view), ".png"))

        shot.on_click(send_screenshot)
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


def describe(status: Status, stamp_ns: int) -> str:
    """Return state, reason and quality, in words."""
    words = [f"**{status.state}**", status.reason, f"{stamp_ns / 1e9:.2f} s", f"quality {status.quality:.2f}"]
    return " · ".join(filter(None, words))


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
