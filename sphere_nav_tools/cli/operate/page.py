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

from sphere_nav.spheres.sphere import to_rgb
from sphere_nav_tools.cli.constants import ALIVE_S, ASK_S, HOLD_HZ, PERIOD_S, PICTURE_S, SILENT_S
from sphere_nav_tools.cli.gate import WebPage
from sphere_nav_tools.cli.operate.chart import BEGIN, Chart, ground_point
from sphere_nav_tools.cli.operate.ground import Ground, ground_of
from sphere_nav_tools.cli.operate.link import GOES_ON, Link
from sphere_nav_tools.cli.operate.look import dressing
from sphere_nav_tools.cli.operate.places import name_place, network_of, way_to
from sphere_nav_tools.cli.operate.simulator import SimulatedVehicle
from sphere_nav_tools.cli.operate.teaching import Teaching
from sphere_nav_tools.cli.operate.words import AT_REST, IS_IT_RUNNING, Heard, banner, health, log_of, timeline

ALIVE_KEY = "sphere_nav_alive"  # nothing is kept under it: any answer tells that the page lives
DARK_KEY = "sphere_nav_dark"
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
        self,
        link: Link,
        teaching: Teaching,
        simulated: SimulatedVehicle | None = None,
        *,
        place: tuple[str, int],
        token: str,
    ) -> None:
        """`place` and `token` as of a WebPage."""
        self.link, self.teaching, self.simulated = link, teaching, simulated
        self._ground: tuple[Path | None, Ground | None] = None, None
        acts = {"emergency_stop": self._press, "state": self.state}  # what needs no websocket
        super().__init__("operate", place, token, acts)
        self.server.initial_camera.position, self.server.initial_camera.look_at = BEGIN, (0.0, 0.0, 0.0)
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

    def ground(self) -> Ground | None:
        """Return the ground of the map in use as soon as it is drawn, which a thread does once."""
        made = self.map_in_use()
        if made is not None and made != self._ground[0]:
            self._ground = made, None
            threading.Thread(target=self._draw_ground, args=(made,), daemon=True).start()
        return self._ground[1]

    def _draw_ground(self, made: Path) -> None:
        try:
            self._ground = made, ground_of(made)
        except (ValueError, OSError) as error:
            self.link.seen.say(str(error))


class Desk:
    """What one browser shows, and the thread that keeps it up to date until the browser leaves."""

    def __init__(self, page: OperatorPage, client: Any) -> None:
        self.page, self.client, self.link, self.teaching = page, client, page.link, page.teaching
        self.chart = Chart(client)
        self._clicked: tuple[float, float] | None = None
        self._is_heard = False
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
        client.scene.on_click()(self._on_click)
        for work in (self._live, self._watch):
            threading.Thread(target=work, daemon=True).start()

    # --- what stands on it
    def _add_stops(self) -> None:
        """Put the emergency stop into the document, then what is possible in this state."""
        gui = self.client.gui
        gui.add_html(dressing())
        self._beat = gui.add_html("")
        self._banner, self._scale = gui.add_html(self.page.state()), gui.add_html("")
        self._release = self._button("release the emergency stop", OTHER, self.link.release_emergency)
        self._buttons = {}
        for name, color in (("start", MOVES), ("resume", MOVES), ("pause", STOPS), ("stop", STOPS)):
            self._buttons[name] = self._button(name, color, partial(self.link.command, name), visible=False)
        self._past, self._log = gui.add_html(""), gui.add_html("")

    def _add_drive(self) -> None:
        gui = self.client.gui
        self._path = gui.add_dropdown("path", self.teaching.paths or [NO_PATH])
        self._load = self._button("load path", OTHER, self._load_path, visible=False)
        self._place = gui.add_dropdown("place", [NO_PLACE])
        self._there = self._button("go there", MOVES, self._go, visible=False)
        self._click = gui.add_dropdown("a click on the map", (LOOKS, GOES, NAMES, POSES))
        self._click.on_update(lambda _: self._on_mode())
        self._to_goal = self._button("make the way to the goal", OTHER, self._go_to_click, visible=False)
        self._new_place = gui.add_text("name of the place", "", visible=False)
        self._keep_place = self._button("name it", OTHER, self._name_place, visible=False)
        self._follows = gui.add_checkbox("map moves with the vehicle", True)
        self._is_watched = gui.add_checkbox("stop the vehicle when this page is lost (dead-man switch)", False)
        self._is_dark = gui.add_checkbox("dark", False)
        self._is_dark.on_update(lambda _: self._dress())

    def _add_teach(self) -> None:
        gui, teaching = self.client.gui, self.teaching
        self._name = gui.add_text("name", "")
        self._record = self._button("record", OTHER, lambda: teaching.record(self._name.value))
        self._job = gui.add_html("")
        self._hands, self._pace = gui.add_html(""), []
        for name, (speed, turn) in PACE.items():
            button = gui.add_button(name, color=MOVES)
            button.on_hold(lambda _, v=speed, w=turn: self._hold(v, w), callback_hz=HOLD_HZ)
            button.on_click(lambda _: self.link.let_go())
            self._pace.append(button)
        if self.page.simulated:
            self._rest = self._button("end localiser and follower", STOPS, self.page.simulated.rest, visible=False)
        self._finish = self._button("end of the drive", OTHER, teaching.finish)
        self._recorded = gui.add_dropdown("drive", teaching.drives or [NO_DRIVE])
        self._map = self._button("make its map", OTHER, lambda: teaching.map(self._recorded.value))
        self._use_map = self._button("localise in its map", OTHER, self._use)

    def _add_camera(self) -> None:
        gui, grey = self.client.gui, to_rgb(np.full((120, 160), 128, np.uint8))
        self._shows_pictures = gui.add_checkbox("show pictures", False)
        self._shows_pictures.on_update(lambda _: self.link.watch_pictures(self._shows_pictures.value))
        self._pictures = {
            "image": gui.add_image(grey, label="camera"),
            "residual": gui.add_image(grey, label="what the map does not explain (grey: as the map)"),
        }

    def _button(self, label: str, color: str, act: Callable[[], str], *, visible: bool = True) -> Any:
        """Return a button that carries out an act."""
        button = self.client.gui.add_button(label, color=color, visible=visible)
        button.on_click(lambda _: self._do(act))
        return button

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

    def _hold(self, speed: float, turn: float) -> None:
        refusal = self.link.hold(speed, turn)
        if refusal and refusal not in "".join(self.link.seen.lines):
            self.link.seen.say(refusal)

    def _go(self) -> str:
        places = self.link.seen.told("places")[0] or ()
        chosen = next((place for place in places if place.name == self._place.value), None)
        if chosen is None:
            return "place: expected one of route_navigator, found none"
        return self.link.go(chosen) if self.link.has_navigator else self._make_way((chosen.x, chosen.y))

    def _go_to_click(self) -> str:
        return self._make_way(self._clicked) if self._clicked else "goal: expected a click on the map, found none"

    def _make_way(self, goal: tuple[float, float]) -> str:
        """Hand the way to a goal to the follower; nothing moves before start is pressed."""
        made, taught = self._in_use()
        pose, age = self.link.seen.told("pose")
        if age > SILENT_S:
            return "goal: expected a localised vehicle, found no pose: see the state of the localisation"
        file = way_to(network_of(made, taught), pose[:3], goal, self.teaching.folder)
        return f"way to {goal[0]:.1f}, {goal[1]:.1f}: {self.link.load_path(str(file))}; start drives"

    def _name_place(self) -> str:
        if self._clicked is None:
            return "place: expected a click on the map, found none"
        made, taught = self._in_use()
        self.link.seen.hear("places", name_place(made, taught, self._new_place.value, *self._clicked))
        told = "; route_navigator reads it when it starts anew" if self.link.has_navigator else ""
        if self.page.simulated:
            self.page.simulated.guide(made)
            told = ""
        return f"place {self._new_place.value}: kept in {made.name}{told}"

    def _in_use(self) -> tuple[Path, Path | None]:
        """Return the map that the localiser uses, and the path taught with it; ValueError where it is not here."""
        made = self.page.map_in_use()
        if made is None:
            raise ValueError(f"map: expected that of the localiser in {self.teaching.folder}, found none")
        return made, self.teaching.path_of(f"{made.name.removesuffix('_map')}.tum")

    def _on_mode(self) -> None:
        """Show what a click on the map is for."""
        mode, scene = self._click.value, self.client.scene
        for part, wanted in ((self._to_goal, GOES), (self._new_place, NAMES), (self._keep_place, NAMES)):
            part.visible = mode == wanted
        if mode != POSES:
            scene.remove_by_name("/floor")
            return
        floor = scene.add_box("/floor", dimensions=(2000.0, 2000.0, 0.01), position=(0.0, 0.0, -0.1), opacity=0.02)
        floor.on_drag("left")(self._on_drag)

    def _on_click(self, event: Any) -> None:
        point = ground_point(event.ray_origin, event.ray_direction)
        if point is not None and self._click.value in (GOES, NAMES):
            self._clicked = float(point[0]), float(point[1])
            self.chart.mark("clicked", [point])

    def _on_drag(self, event: Any) -> None:
        """Show the pose that is dragged; where the button is let go, tell it."""
        camera = np.asarray(self.client.camera.position)
        ends = np.array([event.start_position, event.end_position])
        begin, end = (ground_point(camera, at - camera) for at in ends)
        if begin is None or end is None or np.hypot(*(end - begin)) < 0.1:
            return
        self.chart.mark("dragged", [begin, end])
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
        told = self.link.load_map(str(made))
        return f"{told}; {self.link.load_path(str(path))}" if path else told

    # --- what changes by itself
    def _dress(self) -> None:
        self.client.local_storage.set_item(DARK_KEY, "1" if self._is_dark.value else "")
        self.client.gui.configure_theme(**THEME, dark_mode=self._is_dark.value)

    def _live(self) -> None:
        """Show what is new until the browser leaves."""
        picture_s = 0.0
        try:
            with suppress(TimeoutError):
                self._is_dark.value = bool(self.client.local_storage.get_item(DARK_KEY, timeout=1.0))
            while self.page.has(self.client):
                self._show()
                if self._shows_pictures.value and time.monotonic() - picture_s > PICTURE_S:
                    picture_s = time.monotonic()
                    self._show_pictures()
                time.sleep(PERIOD_S)
        except RuntimeError:
            pass  # it has left
        finally:
            for is_watching in (self._shows_pictures.value, self._is_heard):
                if is_watching:
                    self.link.watch_pictures(False)

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
        seen, teaching = self.link.seen, self.teaching
        told, is_recording = teaching.describe(), teaching.is_recording
        if is_recording != self._is_heard:  # whether images come is of interest as long as a drive is recorded
            self._is_heard = is_recording
            self.link.watch_pictures(is_recording)
            if teaching.name in teaching.drives:
                self._recorded.options, self._recorded.value = tuple(teaching.drives), teaching.name
        self._banner.content = self.page.state()
        self._scale.content = self.chart.scale()
        self._past.content = timeline(seen)
        self._log.content = log_of(seen)
        self._health.content = health(seen)
        self._job.content = INDENTED.format(escape("" if teaching.busy else told))
        pressed = self.link.is_pressed
        self._beat.content = f'<i id="sn-beat" data-beat="{time.monotonic():.1f}" data-pressed="{"1" * pressed}"></i>'
        self._release.visible = pressed
        for name, is_shown in possible(seen, pressed).items():
            self._buttons[name].visible = is_shown
        self._offer()
        for part, choice in (
            (self._path, teaching.paths or [NO_PATH]),
            (self._recorded, teaching.drives or [NO_DRIVE]),
            (self._place, [place.name for place in seen.told("places")[0] or ()] or [NO_PLACE]),
        ):
            if part.options != tuple(choice):
                part.options = choice
        self._there.label = "go there" if self.link.has_navigator else "make the way there"
        self._there.color = MOVES if self.link.has_navigator else OTHER
        self.chart.show(seen, self.page.ground(), self._follows.value)

    def _offer(self) -> None:
        """Show the parts that do something now."""
        seen, teaching = self.link.seen, self.teaching
        takes_path = seen.state in AT_REST
        is_busy = bool(teaching.busy)
        hands_off = self.link.hands_off()
        self._hands.content = INDENTED.format(escape(hands_off or "By hand, while a button is held:"))
        for part, is_shown in (
            *((button, not hands_off) for button in self._pace),
            (self._load, takes_path and bool(teaching.paths)),
            (self._there, takes_path and bool(seen.told("places")[0])),
            *([(self._rest, self.page.simulated.is_driven)] if self.page.simulated else []),
            (self._record, not is_busy),
            (self._finish, teaching.is_recording),
            (self._map, not is_busy and bool(teaching.drives)),
            (self._use_map, not is_busy and teaching.map_of(self._recorded.value) is not None),
        ):
            part.visible = is_shown

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
