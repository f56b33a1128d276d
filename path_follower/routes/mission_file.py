"""What of a mission survives a restart of its node: a small file of JSON, and the course as the follower reads it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from path_follower.path import Pose2
from path_follower.path_files import UNBOUNDED
from path_follower.routes.course import Course
from path_follower.routes.mission import Goal, Mission
from path_follower.routes.planning import Leg
from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import load_json, number, numbers, read_text, required, short
from sphere_nav.geometry.files.whole_file import write_whole
from sphere_nav.geometry.trajectory import MAP_ID
from sphere_nav.params.homes import user_folder

FORMAT, VERSION = "sphere_nav mission", 1
FIELDS = (
    *("format", "version", "map_id", "closed", "permission", "goal", "laps_left", "driven"),
    *("lap_legs", "seconds", "legs", "ends"),
)
MAX_LAPS = 65_535


def state_folder(named: str) -> Path:
    """Return the folder that is named, or that of the user, and make it."""
    if not named:
        return user_folder(".ros/sphere_nav", home_variable="ROS_HOME")
    Path(named).mkdir(parents=True, exist_ok=True)
    return Path(named)


def write_mission(path: Path, mission: Mission) -> None:
    """Write what survives; the file appears whole or not at all."""
    values = {"format": FORMAT, "version": VERSION, **mission.snapshot()}
    write_whole(path, json.dumps(values, allow_nan=False))


def read_mission(path: Path, mission: Mission, now: float) -> None:
    """Give a mission what survived; ValueError in one line for a file that is none, or of another map."""
    where = str(path)
    values = required(load_json(path, read_text(path, "state of a mission", LIMITS["mission"])), where, FIELDS)
    if (values["format"], values["version"]) != (FORMAT, VERSION):
        raise ValueError(f"{where}: expected format {FORMAT!r} version {VERSION}, found {short(values['format'])}")
    if values["map_id"] != mission.network.map_id:
        raise ValueError(f"{where}: map_id: expected that of the network, found {short(values['map_id'])}")
    ends = list(numbers(values["ends"], f"{where}: ends"))
    legs = values["legs"]
    if not isinstance(legs, list) or len(legs) != len(ends):
        raise ValueError(f"{where}: legs: expected {len(ends)}, as many as ends, found {short(legs)}")
    plain = {
        "closed": [int(value) for value in numbers(values["closed"], f"{where}: closed")],
        "permission": int(number(values["permission"], f"{where}: permission")),
        "laps_left": _count(values["laps_left"], f"{where}: laps_left"),
        "driven": number(values["driven"], f"{where}: driven"),
        "lap_legs": [int(value) for value in numbers(values["lap_legs"], f"{where}: lap_legs", 2)],
        "seconds": number(values["seconds"], f"{where}: seconds"),
        "ends": ends,
        "lead": number(values.get("lead", 0.0), f"{where}: lead"),
    }
    mission.restore(_goal(values["goal"], f"{where}: goal"), [_leg(leg, f"{where}: legs") for leg in legs], plain, now)


def write_course(path: Path, course: Course, map_id: str, fastest: float = UNBOUNDED) -> None:
    """Write a course for `load_trajectory`; where its speed is not known it is `fastest`, or the follower's limits."""
    speed = np.where(np.isfinite(course.speed), course.speed, fastest)
    head = f"{MAP_ID} {map_id}\n" if map_id else ""
    rows = np.stack([course.x, course.y, course.yaw, speed], axis=-1).tolist()
    lines = "\n".join(",".join(f"{value:.5f}" for value in row) for row in rows)
    write_whole(path, f"{head}x,y,yaw,speed\n{lines}\n")


def _goal(found: Any, where: str) -> Goal | None:
    if found is None:
        return None
    values = required(found, where, ("place", "pose", "laps", "wait"))
    if not isinstance(values["place"], str):
        raise ValueError(f"{where}.place: expected a name, found {short(values['place'])}")
    pose = None if values["pose"] is None else Pose2(*numbers(values["pose"], f"{where}.pose", 3))
    laps, wait = _count(values["laps"], f"{where}.laps"), number(values["wait"], f"{where}.wait")
    return Goal(values["place"], pose, laps, wait)


def _leg(found: Any, where: str) -> Leg:
    edge, direction, first, last = numbers(found, where, 4)
    return Leg(int(edge), 1 if direction > 0 else -1, first, last)


def _count(found: Any, where: str) -> int:
    value = number(found, where)
    if not 0 <= value <= MAX_LAPS:
        raise ValueError(f"{where}: expected 0 to {MAX_LAPS}, found {short(found)}")
    return int(value)
