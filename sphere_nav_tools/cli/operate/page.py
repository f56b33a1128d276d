"""The page itself: what one browser shows and may press, once the gate has let it in.

Everything is made for each browser by itself (viser's client scope). What a browser says that it chose is looked up
among what it was offered, and is never a path.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from sphere_nav_tools.cli.constants import ALIVE_S, ASK_S, PERIOD_S, PICTURE_S
from sphere_nav_tools.cli.gate import make_server
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.teaching import Teaching
from sphere_nav_tools.cli.operate.words import Place, banner, ellipse, health, log_of, pieces, way_driven
from sphere_nav_tools.cli.view.server import colored

ALIVE_KEY = "sphere_nav_alive"  # nothing is kept under it: any answer tells that the page lives
COLORS = {
    "car": (200, 30, 30),
    "old": (140, 140, 140),
    "path": (40, 90, 160),
    "trail": (220, 120, 30),
    "spheres": (150, 150, 150),
    "place": (20, 130, 60),
}
BODY_M = (1.9, 1.2, 0.6)  # of the box that stands for the vehicle, as the Cycab
NO_PATH, NO_PLACE = "(no path here)", "(no places heard)"


class OperatorPage:
    """Serves any number of browsers until `close`; what one of them presses, all of them see."""

    def __init__(self, link: Link, teaching: Teaching, *, host: str, port: int, token: str) -> None:
        """`token`: of the link to it."""
        self.link, self.teaching = link, teaching
        self._closed = threading.Event()
        self.server = make_server("operate", host, port, token)
        self.server.scene.set_up_direction("+z")
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        self.server.on_client_connect(lambda client: Desk(self, client))

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.server.get_port())

    @property
    def is_closed(self) -> bool:
        """Whether all is over."""
        return self._closed.is_set()

    def close(self) -> None:
        """End the page and the threads of its browsers; the vehicle goes on as it does."""
        self._closed.set()
        self.server.stop()

    def has(self, client: Any) -> bool:
        """Whether a browser is still there."""
        return not self._closed.is_set() and client.client_id in self.server.get_clients()


class Desk:
    """What one browser shows, and the thread that keeps it up to date until the browser leaves."""

    def __init__(self, page: OperatorPage, client: Any) -> None:
        self.page, self.client, self.link, self.teaching = page, client, page.link, page.teaching
        self._drawn: dict[str, int] = {}
        self._places: list[Place] = []
        self._middle = np.zeros(3)  # of what the map shows
        client.camera.position, client.camera.look_at = (-3.0, 0.0, 25.0), (0.0, 0.0, 0.0)
        self._add_stops()
        tabs = client.gui.add_tab_group()
        with tabs.add_tab("drive"):
            self._add_drive()
        with tabs.add_tab("teach"):
            self._add_teach()
        with tabs.add_tab("camera"):
            self._add_camera()
        with tabs.add_tab("health"):
            self._health = client.gui.add_html(health(self.link.seen))
        for work in (self._live, self._watch):
            threading.Thread(target=work, daemon=True).start()

    # --- what stands on it
    def _add_stops(self) -> None:
        """Put the emergency stop twice: first in the panel, and in a window of its own that no list scrolls away."""
        gui = self.client.gui
        self._emergencies = [gui.add_button("EMERGENCY STOP", color="red", icon="hand-stop")]
        window = gui.add_panel()
        with window.add_tab("emergency"):
            self._emergencies.append(gui.add_button("EMERGENCY STOP", color="red", icon="hand-stop"))
        window.float(x=20.0, y=240.0, width=220.0)  # below what a browser reports
        for button in self._emergencies:  # pressed once more it is still pressed: two quick clicks release nothing
            button.on_click(lambda _: self._do(self.link.press_emergency))
        self._release = gui.add_button("release the emergency stop", visible=self.link.is_pressed)
        self._release.on_click(lambda _: self._do(self.link.release_emergency))
        self._banner = gui.add_html(banner(self.link.seen))
        for name, color in (("start", "green"), ("pause", "yellow"), ("resume", "green"), ("stop", "orange")):
            button = gui.add_button(name, color=color)
            button.on_click(lambda _, name=name: self._do(lambda: self.link.command(name)))
        self._log = gui.add_html("")

    def _add_drive(self) -> None:
        gui = self.client.gui
        self._path = gui.add_dropdown("path", self.teaching.paths or [NO_PATH])
        gui.add_button("load path").on_click(lambda _: self._do(self._load_path))
        self._place = gui.add_dropdown("place", [NO_PLACE])
        gui.add_button("go there").on_click(lambda _: self._do(self._go))
        self._follows = gui.add_checkbox("map moves with the vehicle", True)
        self._is_watched = gui.add_checkbox("stop the vehicle when this page is lost (dead-man switch)", False)

    def _add_teach(self) -> None:
        gui, teaching = self.client.gui, self.teaching
        self._name = gui.add_text("name", "")
        gui.add_button("record").on_click(lambda _: self._do(lambda: teaching.record(self._name.value)))
        gui.add_button("end of the drive").on_click(lambda _: self._do(teaching.finish))
        self._recorded = gui.add_dropdown("drive", teaching.drives or [NO_PATH])
        gui.add_button("make its map").on_click(lambda _: self._do(lambda: teaching.map(self._recorded.value)))
        gui.add_button("localise in its map").on_click(lambda _: self._do(self._use))
        self._job = gui.add_markdown("")

    def _add_camera(self) -> None:
        gui, grey = self.client.gui, colored(np.full((120, 160), 128, np.uint8))
        self._shows_pictures = gui.add_checkbox("show pictures", False)
        self._shows_pictures.on_update(lambda _: self.link.watch_pictures(self._shows_pictures.value))
        self._pictures = {
            "image": gui.add_image(grey, label="camera"),
            "residual": gui.add_image(grey, label="what the map does not explain (grey: as the map)"),
        }

    # --- what is pressed
    def _do(self, act: Callable[[], str]) -> None:
        """Carry out what was pressed and tell all browsers how it went."""
        try:
            self.link.seen.say(act())
        except (ValueError, OSError) as error:
            self.link.seen.say(str(error))

    def _load_path(self) -> str:
        path = self.teaching.path_of(self._path.value)
        return self.link.load_path(str(path)) if path else f"path: expected one in {self.teaching.folder}, found none"

    def _go(self) -> str:
        chosen = next((place for place in self._places if place.name == self._place.value), None)
        return self.link.go(chosen) if chosen else "place: expected one of route_navigator, found none"

    def _use(self) -> str:
        name = self._recorded.value
        made, path = self.teaching.map_of(name), self.teaching.path_of(f"{name}.tum")
        if made is None:
            return f"map: expected one in {self.teaching.folder}, found none: make it first"
        told = self.link.load_map(str(made))
        return f"{told}; {self.link.load_path(str(path))}" if path else told

    # --- what changes by itself
    def _live(self) -> None:
        """Show what is new until the browser leaves."""
        picture_s = 0.0
        try:
            while self.page.has(self.client):
                self._show()
                if self._shows_pictures.value and time.monotonic() - picture_s > PICTURE_S:
                    picture_s = time.monotonic()
                    self._show_pictures()
                time.sleep(PERIOD_S)
        except RuntimeError:
            pass  # it has left
        finally:
            if self._shows_pictures.value:
                self.link.watch_pictures(False)

    def _watch(self) -> None:
        """Press the emergency stop when the page is lost while its dead-man switch is on: once, until it lives again.

        An ordinary stop would brake too gently.
        """
        was_lost = has_left = False
        while not (has_left or self.page.is_closed):
            has_left = not self.page.has(self.client)
            is_lost = self._is_watched.value and (has_left or not self._lives())
            if is_lost and not was_lost:
                self._do(lambda: f"dead-man switch: the page is lost: {self.link.press_emergency()}")
            was_lost = is_lost
            time.sleep(ASK_S)

    def _lives(self) -> bool:
        """Whether the browser answers what only a page that lives can answer."""
        try:
            self.client.local_storage.get_item(ALIVE_KEY, timeout=ALIVE_S)
        except TimeoutError:
            return False
        except RuntimeError:  # it has left, or keeps nothing and says so
            return self.page.has(self.client)
        return True

    def _show(self) -> None:
        seen = self.link.seen
        set_if_new(self._banner, "content", banner(seen))
        set_if_new(self._log, "content", log_of(seen))
        set_if_new(self._health, "content", health(seen))
        set_if_new(self._job, "content", f"`{self.teaching.describe()}`" if self.teaching.describe() else "")
        for button in self._emergencies:
            set_if_new(button, "label", "EMERGENCY STOP is pressed" if self.link.is_pressed else "EMERGENCY STOP")
        set_if_new(self._release, "visible", self.link.is_pressed)
        set_if_new(self._path, "options", tuple(self.teaching.paths or [NO_PATH]))
        set_if_new(self._recorded, "options", tuple(self.teaching.drives or [NO_PATH]))
        self._show_places(seen.told("places")[0] or [])
        self._draw("path", seen.told("path")[0], COLORS["path"], 0.02)
        driven = way_driven(seen)
        self._draw("driven", driven, COLORS["trail"], 0.2)  # well above: from far away depths of a browser are coarse
        if driven:
            self._move_map(*driven[-1])
        self._show_spheres(seen.told("spheres")[0])
        self._show_car(*seen.told("pose"))

    def _draw(self, name: str, points: Any, color: tuple[int, ...], height: float) -> None:
        """Draw a line, where it is another one than the last time."""
        if points is None or self._drawn.get(name) == (mark := hash((len(points), np.asarray(points[-1:]).tobytes()))):
            return
        self._drawn[name] = mark
        line = pieces(points, height)
        if len(line):
            self.client.scene.add_line_segments(
                f"/{name}", points=line, colors=color, thickness=3.0, thickness_units="screen"
            )

    def _show_spheres(self, points: Any) -> None:
        if points is None or not len(points) or self._drawn.get("spheres") == len(points):
            return
        self._drawn["spheres"] = len(points)
        solid = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
        self.client.scene.add_point_cloud("/spheres", points=solid, colors=COLORS["spheres"], point_size=0.25)

    def _show_places(self, places: list[Place]) -> None:
        if places == self._places:
            return
        self._places = places
        self._place.options = tuple(place.name for place in places) or (NO_PLACE,)
        for i, place in enumerate(places):
            spot = (place.x, place.y, 0.0)
            ball = self.client.scene.add_icosphere(f"/place_{i}", radius=0.5, color=COLORS["place"], position=spot)
            ball.on_click(lambda _, name=place.name: set_if_new(self._place, "value", name))
            self.client.scene.add_label(f"/place_{i}/name", place.name)

    def _show_car(self, pose: Any, age: float) -> None:
        if pose is None:
            return
        x, y, yaw, covariance = pose
        color = COLORS["car" if age < 1.0 else "old"]
        turned = (float(np.cos(0.5 * yaw)), 0.0, 0.0, float(np.sin(0.5 * yaw)))
        ahead = (x + 0.6 * np.cos(yaw), y + 0.6 * np.sin(yaw), 0.5 * BODY_M[2])  # the base is the rear axle
        scene = self.client.scene
        if self._drawn.get("car") != hash(color):
            self._drawn["car"] = hash(color)
            self._car = scene.add_box("/car", color=color, dimensions=BODY_M, opacity=0.8)
        self._car.position, self._car.wxyz = ahead, turned
        outline = pieces(ellipse(x, y, covariance), BODY_M[2] + 0.05)
        scene.add_line_segments("/covariance", points=outline, colors=color, thickness=2.0, thickness_units="screen")

    def _move_map(self, x: float, y: float) -> None:
        """Move the view as the vehicle moves; how it is turned and how near it is, the mouse says."""
        step = np.array([x, y, 0.0]) - self._middle
        if not self._follows.value or np.hypot(*step[:2]) < 0.5:
            return
        camera, self._middle = self.client.camera, self._middle + step
        with self.client.atomic():
            position, look_at = np.array(camera.position) + step, np.array(camera.look_at) + step
            camera.position, camera.look_at = position, look_at

    def _show_pictures(self) -> None:
        for name, shown in self._pictures.items():
            gray = self.link.picture(name)
            if gray is not None:
                scale = min(1.0, 320 / gray.shape[1])
                shown.image = colored(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def set_if_new(handle: Any, field: str, value: Any) -> None:
    """Set what a part of the page shows; what is there already is not sent again."""
    if getattr(handle, field) != value:
        setattr(handle, field, value)
