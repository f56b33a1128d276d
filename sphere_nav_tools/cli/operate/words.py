"""What the page shows, from what was heard: texts, and lines on the map. Knows neither DDS nor the browser."""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from sphere_nav.geometry.arrays import Array, Floats
from sphere_nav.geometry.files.untrusted import load_json
from sphere_nav_tools.cli.constants import SELDOM_S, SILENT_S

MAX_TOLD = 50  # lines of the log
MAX_DRAWN = 2000  # points of a line on the map
GOOD, FAIR, BAD, NONE = "#2b8a3e", "#b35c00", "#c92a2a", "#666666"
# One colour a meaning: green is as wanted, orange is slower or not yet, red stands for a reason, grey is at rest.
COLORS = {"RECORDING": GOOD, "MAPPING": GOOD, "DRIVING": GOOD, "FINISHED": GOOD, "TRACKING": GOOD}
COLORS |= {"SLOW": FAIR, "PAUSED": FAIR, "DEGRADED": FAIR}
COLORS |= {"IDLE": NONE, "NO_PATH": NONE, "PROBATION": FAIR, "SEARCHING": FAIR, "STOPPING": FAIR}
CALL = re.compile(r"\bcall (start|resume|stop)\b")  # of a node, where a reader of the page has buttons
RELOCALIZE = re.compile(r"\b(call )?relocalize( of the localiser)?\b")
AT_REST = ("NO_PATH", "IDLE", "STOPPED", "FINISHED")
IS_IT_RUNNING = "is the node running, in this domain and namespace?"


class Place(NamedTuple):
    """A named place of the network, m in the map."""

    name: str
    x: float
    y: float


class Heard:
    """The newest of everything that was heard, with its age, and the lines that tell what was done."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[Any, float]] = {}
        self.lines: deque[str] = deque(maxlen=MAX_TOLD)
        self.refused = ""  # the last command, and why, until the next one

    def hear(self, name: str, value: Any) -> None:
        """Keep a value; what the follower does, and since when it was silent, is told among what was done."""
        now = time.monotonic()
        last, heard = self._told.get(name, (None, now))
        self._told[name] = value, now
        if name == "follower":
            silence = f" after {now - heard:.0f} s of silence" * (now - heard > SILENT_S)
            if silence or last is None or (last.state, last.reason) != (value.state, value.reason):
                self.say(f"vehicle: {value.state} {value.reason}".rstrip() + silence)

    def told(self, name: str) -> tuple[Any, float]:
        """Return the newest value and its age in s; None and infinity before the first."""
        value, heard = self._told.get(name, (None, -math.inf))
        return value, time.monotonic() - heard

    @property
    def state(self) -> str:
        """Of the follower; empty while it is silent."""
        status, age = self.told("follower")
        return status.state if age <= SILENT_S else ""

    @property
    def is_moving(self) -> bool:
        """Whether the follower tells that the vehicle does not stand."""
        return self.state not in ("", *AT_REST)

    @property
    def mission(self) -> str:
        """State of the mission; IDLE where no navigator tells of one."""
        mission, age = self.told("mission")
        return mission.state if age < SELDOM_S else "IDLE"

    @property
    def placed(self) -> str:
        """By what it is known where the vehicle is: `pose` in the map, `wheels` where nobody localises."""
        return "wheels" if self.told("pose")[0] is None else "pose"

    @property
    def places(self) -> Sequence[Place]:
        """The named places, as far as they were heard."""
        return self.told("places")[0] or ()

    def say(self, line: str) -> None:
        """Add a line to what was done."""
        self.lines.appendleft(f"{time.strftime('%H:%M:%S')} {by_buttons(line)}")


def by_buttons(text: str, state: str = "") -> str:
    """Return what a node says to do in the words of what is on the page; in a state of the follower."""
    text = RELOCALIZE.sub("drag the vehicle on the map to where it is", text)
    instead = {"PAUSED": "press resume", "NO_PATH": "load a path or choose a place"}  # where there is no start
    return CALL.sub(lambda found: instead.get(state, f"press {found[1]}"), text)


def places_of(text: str) -> list[Place]:
    """Return the named points of a network in GeoJSON (`path_follower/routes`)."""
    points = [one for one in load_json("network", text)["features"] if one["geometry"]["type"] == "Point"]
    named = [(name, one["geometry"]["coordinates"]) for one in points for name in one["properties"].get("names", ())]
    return [Place(str(name), float(x), float(y)) for name, (x, y) in named]


def banner(seen: Heard, job: str = "", remedy: str = IS_IT_RUNNING) -> str:
    """Return state, reason and remedy of vehicle and localiser as HTML, the vehicle's first and large.

    `job`: what is being recorded or mapped; `remedy`: where nothing was heard; whatever the nodes say is text.
    """
    word, _, rest = job.partition(" ")
    rows = [_row("teaching", word.upper(), rest, "")] if job else []
    for title, name in (("vehicle", "follower"), ("localisation", "localizer")):
        status, age = seen.told(name)
        if status is None and job:
            continue  # no node is needed to teach
        if status is None or age > SILENT_S:
            since = f"silent for {age:.0f} s" if status is not None else "nothing heard"
            rows.append(_row(title, "UNKNOWN", since, remedy if not rows else ""))
            continue
        found = f"{status.value:.3g}, limit {status.limit:.3g}" if status.limit else ""
        remedy = by_buttons(status.remedy, status.state)
        rows.append(_row(title, status.state, f"{status.reason} {found}".strip(), remedy))
    rows[0] = rows[0].replace("<b ", '<b class="sn-word" ', 1)
    if seen.state:
        status, _ = seen.told("follower")
        rows.append(f"<div>{status.progress:.1f} m driven, {status.distance_to_end:.1f} m to the end</div>")
    if seen.mission != "IDLE":
        mission, _ = seen.told("mission")
        left = f"{mission.distance_remaining:.0f} m, {mission.time_remaining:.0f} s to {mission.next_place}"
        rows.append(f"<div>mission: {escape(mission.state)} on {escape(mission.edge)}, {escape(left)}</div>")
    return f'<div class="sn-state">{"".join(rows)}</div>'


def _row(title: str, state: str, reason: str, remedy: str) -> str:
    color = NONE if reason == "nothing heard" else COLORS.get(state, BAD)
    why = f"<div>{escape(reason)}</div>" if reason else ""
    what = f"<div>&rarr; {escape(remedy)}</div>" if remedy else ""
    head = f'<b style="background:{color};color:white;padding:0 0.4em">{escape(state)}</b> {escape(title)}'
    return f'<div style="margin-bottom:0.4em">{head}{why}{what}</div>'


def round_length(most: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not above a length."""
    length = 10.0 ** math.floor(math.log10(most))
    return float(length * next(factor for factor in (5.0, 2.0, 1.0) if factor * length <= most))


def log_of(seen: Heard) -> str:
    """Return what was done as HTML, the newest first; before it, the command that was refused."""
    refused = f'<div class="sn-refused">NOT DONE: {escape(seen.refused)}</div>' if seen.refused else ""
    lines = "".join(f"<div>{escape(line)}</div>" for line in list(seen.lines))
    return f'{refused}<div class="sn-log" style="padding:0 1em 0.8em;font-size:0.8em">{lines}</div>'


def ellipse(covariance: Array) -> Array:
    """Return points (N, 2) of the closed line that a place (covariance (2, 2) m^2) is within, at 2 deviations."""
    axes, values, _ = np.linalg.svd(covariance)
    turn = np.linspace(0.0, 2.0 * np.pi, 48)
    return np.stack([np.cos(turn), np.sin(turn)], axis=-1) * (2.0 * np.sqrt(values)) @ axes.T


def pieces(points: Any, height: float) -> Floats:
    """Return the pieces (N, 2, 3) of a line through points (M, 2), at most `MAX_DRAWN`."""
    line = np.asarray(points, dtype=np.float32).reshape(-1, 2)
    line = line[np.unique(np.linspace(0, len(line) - 1, min(len(line), MAX_DRAWN)).astype(int))]
    solid = np.column_stack([line, np.full(len(line), height, np.float32)])
    return np.stack([solid[:-1], solid[1:]], axis=1)
