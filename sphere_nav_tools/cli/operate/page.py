"""The page itself: what one browser shows and may press, once the gate has let it in.

Everything is made for each browser by itself (viser's client scope). What a browser says that it chose is looked up
among what it was offered, and is never a path.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from path_follower.routes.network_file import network_path
from sphere_nav.spheres.sphere import to_rgb
from sphere_nav_tools.cli.constants import ALIVE_S, PERIOD_S, SILENT_S, STRIDE_S
from sphere_nav_tools.cli.gate import Address, WebPage
from sphere_nav_tools.cli.operate.chart import Chart, ground_point
from sphere_nav_tools.cli.operate.link import GOES_ON, LOAD_MAP, LOAD_PATH, Link
from sphere_nav_tools.cli.operate.look import dressing
from sphere_nav_tools.cli.operate.teaching import SimulatedVehicle, Teaching
from sphere_nav_tools.cli.operate.words import AT_REST, IS_IT_RUNNING, Heard, Place, banner, log_of
from sphere_nav_tools.offline.routes import name_place, network_of, way_to

ALIVE_KEY = "sphere_nav_alive"  # nothing is kept under it: any answer tells that the page lives
THEME: dict[str, Any] = {"show_logo": False, "show_share_button": False, "control_width": "large"}
NO_PATH, NO_DRIVE, NO_PLACE = "(no path here)", "(no drive here)", "(no places heard)"
STOPS, MOVES, OTHER = "red", "green", "blue"  # what a button does to the vehicle
TEACH_FIRST = "teach it: record a drive, make its map, localise in it"  # of a simulated vehicle
INDENTED = '<div style="padding:0 1em">{}</div>'
LOOKS, GOES, NAMES, POSES = "only looks", "sets a goal", "chooses a place to name", "dragged: where the vehicle is"
PACE = {  # by hand: m/s, rad/s
    "ahead": (0.8, 0.0),
    "ahead, to the left": (0.6, 0.3),
    "ahead, to the right": (0.6, -0.3),
    "back": (-0.4, 0.0),
}


class OperatorPage(WebPage):
    """Serves any number of browsers until `close`; what one of them presses, all of them see."""

    def __init__(
        self, address: Address, link: Link, teaching: Teaching, simulated: SimulatedVehicle | None = None
    ) -> None:
        self.link, self.teaching, self.simulated = link, teaching, simulated
        super().__init__(address, {"emergency_stop": self._press, "state": self.state})  # what needs no websocket
        self.server.gui.configure_theme(**THEME)
        self.server.gui.main_panel.dock_right()
        self.server.on_client_connect(lambda client: Desk(self, client))

    def _press(self) -> str:
        """Press the emergency stop by a thread: who asked for it is answered at once."""
        threading.Thread(target=lambda: self.link.seen.say(self.link.press_emergency()), daemon=True).start()
        return "asked for"

    def state(self) -> str:
        """Return what is going on as HTML."""
        is_new = self.simulated is not None and not self.simulated.is_driven
        job = self.teaching.describe() if self.teaching.busy else ""
        job += f" · {self.link.describe_images()}" * self.teaching.is_recording
        return banner(self.link.seen, job, TEACH_FIRST if is_new else IS_IT_RUNNING)

    def map_in_use(self) -> Path | None:
        """Return the map in the folder that the localiser uses; None where it is not here."""
        status, _ = self.link.seen.told("localizer")
        return self.teaching.with_map(status.map_id) if status is not None else None


class Desk:
    """What one browser shows, and the thread that keeps it up to date until the browser leaves."""

    def __init__(self, page: OperatorPage, client: Any) -> None:
        self.page, self.client, self.link, self.teaching = page, client, page.link, page.teaching
        self.seen, self.chart = page.link.seen, Chart(client)
        self._clicked: tuple[float, float] | None = None
        self._hands_off = ""
        self._texts: list[tuple[Any, Callable[[], str]]] = []  # parts, and what they tell
        self._shown: list[tuple[Any, Callable[[], object]]] = []  # parts, and when they do something
        self._add_stops()
        tabs = client.gui.add_tab_group()
        with tabs.add_tab("drive"):
            self._add_drive()
        with tabs.add_tab("teach"):
            self._add_teach()
        with tabs.add_tab("camera"):
            self._add_camera()
        client.scene.on_click()(self._on_click)
        for work in (self._live, self._watch):
            threading.Thread(target=work, daemon=True).start()

    # --- what stands on it
    def _add_stops(self) -> None:
        """Put the emergency stop into the document, then what is possible in this state."""
        link = self.link
        self.client.gui.add_html(dressing())
        for tell in (self._beat, self.page.state, self.chart.scale):
            self._text(tell)
        self._button("release the emergency stop", OTHER, link.release_emergency, lambda: link.is_pressed)
        for name, color in (("start", MOVES), ("resume", MOVES), ("pause", STOPS), ("stop", STOPS)):
            self._button(name, color, partial(link.command, name), partial(self._is_possible, name))
        self._text(lambda: log_of(self.seen))

    def _beat(self) -> str:
        """Return what tells the browser that it is heard, and whether the emergency stop is pressed."""
        pressed = "1" * self.link.is_pressed
        return f'<i id="sn-beat" data-beat="{time.monotonic():.1f}" data-pressed="{pressed}"></i>'

    def _add_drive(self) -> None:
        gui, link, seen = self.client.gui, self.link, self.seen
        self._path = gui.add_dropdown("path", self.teaching.paths or [NO_PATH])
        self._button("load path", OTHER, self._load_path, lambda: seen.state in AT_REST and self.teaching.paths)
        self._place = gui.add_dropdown("place", [NO_PLACE])
        go, make_way = lambda: link.go(self._chosen()), lambda: self._make_way(self._chosen()[1:])
        self._button("go there", MOVES, go, lambda: self._has_places() and link.has_navigator)
        self._button("make the way there", OTHER, make_way, lambda: self._has_places() and not link.has_navigator)
        self._click = gui.add_dropdown("a click on the map", (LOOKS, GOES, NAMES, POSES))
        self._click.on_update(lambda _: self._on_mode())
        self._button(
            "make the way to the goal",
            OTHER,
            lambda: self._make_way(self._clicked_at()),
            lambda: self._click.value == GOES,
        )
        self._new_place = self._where(gui.add_text("name of the place", ""), lambda: self._click.value == NAMES)
        self._button("name it", OTHER, self._name_place, lambda: self._click.value == NAMES)
        self._follows = gui.add_checkbox("map moves with the vehicle", True)
        self._is_watched = gui.add_checkbox("stop the vehicle when this page is lost (dead-man switch)", False)

    def _add_teach(self) -> None:
        gui, teaching, simulated = self.client.gui, self.teaching, self.page.simulated
        self._name = gui.add_text("name", "")
        self._button("record", OTHER, lambda: teaching.record(self._name.value), lambda: not teaching.busy)
        self._text(lambda: INDENTED.format(escape("" if teaching.busy else teaching.describe())))
        self._text(lambda: INDENTED.format(escape(self._hands_off or "By hand, while a button is held:")))
        for name, (speed, turn) in PACE.items():
            button = self._where(gui.add_button(name, color=MOVES), lambda: not self._hands_off)
            button.on_hold(partial(self._hold, speed, turn), callback_hz=1.0 / STRIDE_S)
            button.on_click(lambda _: self.link.let_go())
        if simulated:
            self._button("end localiser and follower", STOPS, simulated.rest, lambda: simulated.is_driven)
        self._button("end of the drive", OTHER, teaching.finish, lambda: teaching.is_recording)
        self._recorded = gui.add_dropdown("drive", [NO_DRIVE])
        self._button(
            "make its map",
            OTHER,
            lambda: teaching.map(self._recorded.value),
            lambda: teaching.drives and not teaching.busy,
        )
        self._button(
            "localise in its map",
            OTHER,
            self._use,
            lambda: teaching.map_of(self._recorded.value) and not teaching.busy,
        )

    def _add_camera(self) -> None:
        gui, grey = self.client.gui, to_rgb(np.full((120, 160), 128, np.uint8))
        self._shows_pictures = gui.add_checkbox("show pictures", False)
        self._pictures = {
            "image": gui.add_image(grey, label="camera"),
            "residual": gui.add_image(grey, label="what the map does not explain (grey: as the map)"),
        }

    def _text(self, tell: Callable[[], str]) -> None:
        """Show what is told now, as HTML."""
        self._texts.append((self.client.gui.add_html(""), tell))

    def _button(self, label: str, color: str, act: Callable[[], str], holds: Callable[[], object]) -> None:
        """Add a button that carries out an act, shown where something holds."""
        button = self._where(self.client.gui.add_button(label, color=color), holds)
        button.on_click(lambda _: self._do(act))

    def _where(self, part: Any, holds: Callable[[], object]) -> Any:
        """Show a part only where something holds."""
        part.visible = False
        self._shown.append((part, holds))
        return part

    def _is_possible(self, command: str) -> bool:
        return possible(self.seen, self.link.is_pressed)[command]

    def _has_places(self) -> bool:
        return self.seen.state in AT_REST and bool(self.seen.places)

    # --- what is pressed
    def _do(self, act: Callable[[], str]) -> None:
        """Carry out what was pressed and tell all browsers how it went."""
        try:
            self.seen.say(act())
        except (ValueError, OSError) as error:
            self.seen.say(str(error))

    def _load_path(self) -> str:
        path = self.teaching.path_of(self._path.value)
        return self.link.load(LOAD_PATH, path) if path else f"path: expected one in {self.teaching.folder}, found none"

    def _hold(self, speed: float, turn: float, _: Any) -> None:
        refusal = self.link.hold(speed, turn)
        if refusal and refusal not in "".join(self.seen.lines):
            self.seen.say(refusal)

    def _chosen(self) -> Place:
        for place in self.seen.places:
            if place.name == self._place.value:
                return place
        raise ValueError("place: expected one of route_navigator, found none")

    def _clicked_at(self) -> tuple[float, float]:
        if self._clicked is None:
            raise ValueError("map: expected a click on it, found none")
        return self._clicked

    def _make_way(self, goal: tuple[float, float]) -> str:
        """Hand the way to a goal to the follower; nothing moves before start is pressed."""
        made, taught = self._in_use()
        pose, age = self.seen.told("pose")
        if age > SILENT_S:
            return "goal: expected a localised vehicle, found no pose: see the state of the localisation"
        file = way_to(network_of(made, taught), pose[:3], goal, self.teaching.folder)
        return f"way to {goal[0]:.1f}, {goal[1]:.1f}: {self.link.load(LOAD_PATH, file)}; start drives"

    def _name_place(self) -> str:
        made, taught = self._in_use()
        name, file = self._new_place.value, network_path(made)
        named = name_place(file, network_of(made, taught), name, *self._clicked_at())
        self.seen.hear("places", [Place(place, *named.nodes[node][:2]) for place, node in named.places.items()])
        told = f"place {name}: kept in {made.name}"
        if self.page.simulated:
            self.page.simulated.guide(made)
        elif self.link.has_navigator:
            told += "; route_navigator reads it when it starts anew"
        return told

    def _in_use(self) -> tuple[Path, Path | None]:
        """Return the map that the localiser uses, and the path taught with it; ValueError where it is not here."""
        made = self.page.map_in_use()
        if made is None:
            raise ValueError(f"map: expected that of the localiser in {self.teaching.folder}, found none")
        return made, self.teaching.path_of(f"{made.name.removesuffix('_map')}.tum")

    def _on_mode(self) -> None:
        """Lay a floor, on which a pose can be dragged, where a click on the map is for that."""
        scene = self.client.scene
        scene.remove_by_name("/floor")
        if self._click.value == POSES:
            floor = scene.add_box("/floor", dimensions=(2000.0, 2000.0, 0.01), position=(0.0, 0.0, -0.1), opacity=0.02)
            floor.on_drag("left")(self._on_drag)

    def _on_click(self, event: Any) -> None:
        point = ground_point(event.ray_origin, event.ray_direction)
        if point is not None and self._click.value in (GOES, NAMES):
            self._clicked = float(point[0]), float(point[1])
            self.chart.mark("clicked", point)

    def _on_drag(self, event: Any) -> None:
        """Show the pose that is dragged; where the button is let go, tell it."""
        camera = np.asarray(self.client.camera.position)
        begin, end = (ground_point(camera, np.array(at) - camera) for at in (event.start_position, event.end_position))
        if begin is None or end is None or np.hypot(*(end - begin)) < 0.1:
            return
        self.chart.mark("dragged", begin, end)
        if event.phase == "end":
            yaw = math.atan2(*(end - begin)[::-1])
            self._do(lambda: self.link.guess_pose(float(begin[0]), float(begin[1]), yaw))

    def _use(self) -> str:
        name = self._recorded.value
        made, path = self.teaching.map_of(name), self.teaching.path_of(f"{name}.tum")
        if made is None:
            return f"map: expected one in {self.teaching.folder}, found none: make it first"
        if self.page.simulated is not None and path is not None:
            return self.page.simulated.use(made, path)
        told = self.link.load(LOAD_MAP, made)
        return f"{told}; {self.link.load(LOAD_PATH, path)}" if path else told

    # --- what changes by itself

    def _live(self) -> None:
        """Show what is new until the browser leaves."""
        with suppress(RuntimeError):  # it has left
            while self.page.has(self.client):
                self._show()
                time.sleep(PERIOD_S)

    def _watch(self) -> None:
        """Press the emergency stop when the page is lost while its dead-man switch is on: once, until it lives again.

        An ordinary stop would brake too gently.
        """
        was_lost = has_left = False
        while not (has_left or self.page.closed.is_set()):
            has_left = not self.page.has(self.client)
            is_lost = self._is_watched.value and (has_left or not self._lives())
            if is_lost and not was_lost:
                self._do(lambda: f"dead-man switch: the page is lost: {self.link.press_emergency()}")
            was_lost = is_lost
            time.sleep(PERIOD_S)

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
        seen, teaching, self._hands_off = self.seen, self.teaching, self.link.hands_off()
        for part, tell in self._texts:
            part.content = tell()
        for part, choice in (
            (self._path, teaching.paths or [NO_PATH]),
            (self._recorded, teaching.drives or [NO_DRIVE]),
            (self._place, [place.name for place in seen.places] or [NO_PLACE]),
        ):
            if part.options != tuple(choice):
                part.options = choice
                if part is self._recorded and teaching.name in choice:  # it has just been recorded
                    part.value = teaching.name
        for part, holds in self._shown:
            part.visible = bool(holds())
        self.chart.show(seen, self._follows.value)
        if self._shows_pictures.value:
            self._show_pictures()
        if self._shows_pictures.value or teaching.is_recording:  # whether images come is told while a drive is recorded
            self.link.want_pictures()

    def _show_pictures(self) -> None:
        for name, shown in self._pictures.items():
            gray = self.link.picture(name)
            if gray is not None:
                scale = min(1.0, 320 / gray.shape[1])
                shown.image = to_rgb(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def possible(seen: Heard, is_pressed: bool) -> dict[str, bool]:
    """Return which commands do something now. A stop does wherever it is not known that the vehicle stands."""
    state, mission, is_heard = seen.state, seen.mission, seen.told("follower")[0] is not None
    return {
        "start": state in ("IDLE", "STOPPED", "FINISHED") and mission == "IDLE" and not is_pressed,
        "resume": (state == "PAUSED" or mission in ("PAUSED", "HELD")) and not is_pressed,
        "pause": state in ("DRIVING", "SLOW") or mission in GOES_ON,
        "stop": (state not in AT_REST and is_heard) or mission != "IDLE",
    }
