"""What of a mission survives a restart of its node: a small file of JSON, and the course as the follower reads it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from path_follower.path_files import UNBOUNDED
from path_follower.routes.mission import Mission, MissionRecord
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import load_json, read_as, read_text, required, short
from sphere_nav.geometry.files.whole_file import write_whole
from sphere_nav.geometry.trajectory import MAP_ID
from sphere_nav.params.homes import user_folder

FORMAT, VERSION = "sphere_nav mission", 4
MAX_LAPS = 65_535


def state_folder(named: str) -> Path:
    """Return the folder that is named, or that of the user, and make it."""
    if not named:
        return user_folder(".ros/sphere_nav", home_variable="ROS_HOME")
    Path(named).mkdir(parents=True, exist_ok=True)
    return Path(named)


def write_mission(path: Path, mission: Mission) -> None:
    """Write what survives; the file appears whole or not at all."""
    values = {"format": FORMAT, "version": VERSION, **asdict(mission.snapshot())}
    write_whole(path, json.dumps(values, allow_nan=False))


def read_mission(path: Path, mission: Mission, now: float) -> None:
    """Give a mission what survived; ValueError in one line for a file that is none, or of another map."""
    found = required(load_json(path, read_text(path, "state of a mission", LIMITS["mission"])), str(path), ("version",))
    if (found.get("format"), found["version"]) != (FORMAT, VERSION):
        raise ValueError(f"{path}: expected format {FORMAT!r} version {VERSION}, found {short(found['version'])}")
    record: MissionRecord = read_as(MissionRecord, found, str(path))
    if record.map_id != mission.network.map_id:
        raise ValueError(f"{path}: map_id: expected that of the network, found {short(record.map_id)}")
    for laps in (record.laps_remaining, record.goal.laps if record.goal else 0):
        if not 0 <= laps <= MAX_LAPS:
            raise ValueError(f"{path}: laps: expected 0 to {MAX_LAPS}, found {laps}")
    mission.restore(record, now)


def write_course(path: Path, points: Array, map_id: str, fastest: float = UNBOUNDED) -> None:
    """Write points of `make_course` for the follower; where a speed is not known it is `fastest`, or its limits."""
    head = f"{MAP_ID} {map_id}\n" if map_id else ""
    rows = np.where(np.isfinite(points), points, fastest).tolist()
    lines = "\n".join(",".join(f"{value:.5f}" for value in row) for row in rows)
    write_whole(path, f"{head}x,y,yaw,speed\n{lines}\n")
