"""What the page shows, from what was heard: texts, and lines on the map. Knows neither DDS nor the browser."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from html import escape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.files.untrusted import load_json, number
from sphere_nav_tools.cli.constants import MISSION_S, SILENT_S

MAX_TOLD = 8  # lines of the log that are shown
MAX_DRAWN = 2000  # points of a line on the map
LEVELS = ("OK", "WARN", "ERROR", "STALE")
GOOD, FAIR, BAD, NONE = "#2b8a3e", "#b35c00", "#c92a2a", "#666666"
COLORS = {"DRIVING": GOOD, "FINISHED": GOOD, "TRACKING": GOOD, "SLOW": FAIR, "PAUSED": FAIR, "DEGRADED": FAIR}
COLORS |= {"IDLE": NONE, "NO_PATH": NONE, "PROBATION": FAIR, "SEARCHING": FAIR}


class Place(NamedTuple):
    """A named place of the network, m in the map."""

    name: str
    x: float
    y: float


class Heard:
    """The newest of everything that was heard, with its age, and the lines that tell what was done."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[Any, float]] = {}
        self._lock = threading.Lock()
        self.lines: deque[str] = deque(maxlen=MAX_TOLD)

    def hear(self, name: str, value: Any) -> None:
        """Keep a value."""
        with self._lock:
            self._told[name] = value, time.monotonic()

    def told(self, name: str) -> tuple[Any, float]:
        """Return the newest value and its age in s; None and infinity before the first."""
        with self._lock:
            value, heard = self._told.get(name, (None, -math.inf))
        return value, time.monotonic() - heard

    def say(self, line: str) -> None:
        """Add a line to what was done."""
        self.lines.appendleft(f"{time.strftime('%H:%M:%S')} {line}")


def places_of(text: str) -> list[Place]:
    """Return the named points of a network in GeoJSON (`path_follower/routes`); ValueError for what is none."""
    found, places = load_json("network", text), []
    features = found.get("features") if isinstance(found, dict) else None
    for i, feature in enumerate(features if isinstance(features, list) else []):
        geometry, properties = (feature.get(key) or {} for key in ("geometry", "properties"))
        if geometry.get("type") == "Point":
            x, y = (number(value, f"network: features[{i}]: coordinates") for value in geometry["coordinates"][:2])
            places += [Place(str(name), x, y) for name in properties.get("names", ())]
    return places


def banner(seen: Heard) -> str:
    """Return state, reason and remedy of follower and localiser as HTML; whatever they say is text."""
    rows = []
    for title, name in (("vehicle", "follower"), ("localisation", "localizer")):
        status, age = seen.told(name)
        if status is None or age > SILENT_S:
            since = f"silent for {age:.0f} s" if status is not None else "nothing heard"
            rows.append(_row(title, "UNKNOWN", since, "is the node running, in this domain and namespace?"))
            continue
        found = f"{status.value:.3g}, limit {status.limit:.3g}" if status.limit else ""
        reason = " ".join(word for word in (status.reason, found) if word)
        rows.append(_row(title, status.state, reason, status.remedy))
    status, age = seen.told("follower")
    if status is not None and age <= SILENT_S:
        rows.append(f"<div>{status.progress:.1f} m driven, {status.distance_to_end:.1f} m to the end</div>")
    mission, age = seen.told("mission")
    if age < MISSION_S and mission.state != "IDLE":
        left = f"{mission.distance_remaining:.0f} m, {mission.time_remaining:.0f} s to {mission.next_place}"
        rows.append(f"<div>mission: {escape(mission.state)} on {escape(mission.edge)}, {escape(left)}</div>")
    return f'<div style="padding:0 1em;font-size:0.9em">{"".join(rows)}</div>'


def _row(title: str, state: str, reason: str, remedy: str) -> str:
    color = COLORS.get(state, BAD)
    why = f"<div>{escape(reason)}</div>" if reason else ""
    what = f"<div>&rarr; {escape(remedy)}</div>" if remedy else ""
    head = f'<b style="background:{color};color:white;padding:0 0.4em">{escape(state)}</b> {escape(title)}'
    return f'<div style="margin-bottom:0.4em">{head}{why}{what}</div>'


def log_of(seen: Heard) -> str:
    """Return what was done as HTML, the newest first."""
    lines = "".join(f"<div>{escape(line)}</div>" for line in list(seen.lines))
    return f'<div style="padding:0 1em;font-size:0.8em">{lines}</div>'


def health(seen: Heard) -> str:
    """Return /diagnostics as HTML, what is wrong first; an entry that is not repeated becomes STALE."""
    known, _ = seen.told("diagnostics")
    now, rows = time.monotonic(), []
    for name, (level, text, heard) in (known or {}).items():
        rows.append((-level if now - heard < 5 * SILENT_S else -3, name, text))
    cells = []
    for level, name, text in sorted(rows):
        color = (GOOD, FAIR, BAD, NONE)[min(-level, 3)]
        word = LEVELS[min(-level, 3)]
        cells.append(f'<div><b style="color:{color}">{word}</b> {escape(name)}: {escape(text)}</div>')
    return f'<div style="padding:0 1em;font-size:0.8em">{"".join(cells) or "nothing heard"}</div>'


def ellipse(x: float, y: float, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 2) of the closed line that a place (m, covariance (2, 2) m^2) is within, at 2 deviations."""
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    turn = np.linspace(0.0, 2.0 * np.pi, 48)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    points: NDArray[np.float64] = circle * (2.0 * np.sqrt(np.maximum(values, 0.0))) @ axes.T + (x, y)
    return points


def way_driven(seen: Heard) -> Any:
    """Return the way driven, points (x, y): in the map, or by the wheels where nobody localises; None for none."""
    return seen.told("odometry" if seen.told("pose")[0] is None else "trail")[0]


def pieces(points: Any, height: float) -> NDArray[np.float32]:
    """Return the pieces (N, 2, 3) of a line through points (M, 2), at most `MAX_DRAWN`; none through fewer than two."""
    line = np.asarray(points, dtype=np.float32).reshape(-1, 2)
    if len(line) > MAX_DRAWN:
        line = line[np.unique(np.linspace(0, len(line) - 1, MAX_DRAWN).astype(int))]
    solid = np.column_stack([line, np.full(len(line), height, np.float32)])
    return np.stack([solid[:-1], solid[1:]], axis=1) if len(solid) > 1 else np.empty((0, 2, 3), np.float32)
