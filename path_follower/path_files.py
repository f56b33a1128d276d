"""Reference trajectories and drives in files: TUM poses of a taught drive, CSV, and YAML of a nav_msgs/Path."""

from __future__ import annotations

import os
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np

from path_follower.constants import MAX_POINTS
from path_follower.params import FollowerParams, PathFollowerParams
from path_follower.path import ReferencePath
from path_follower.smoothing import TaughtDrive
from path_follower.taught import Given, make_drives, make_path, taught_speeds, told_headings
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import load_yaml, number, read_as, read_text, required, short, told_at
from sphere_nav.geometry.files.whole_file import write_whole
from sphere_nav.geometry.trajectory import MAP_ID, read_map_id, read_tum

COLUMNS = ("x", "y", "yaw", "speed")
UNBOUNDED = 1e3  # m/s


def read_path(path: str | os.PathLike[str], params: FollowerParams) -> ReferencePath:
    """Read a file by its ending; ValueError in one line: file, line or field, expected, found."""
    file = Path(path)
    given = read_given(file)
    expected_frame = params.map_frame if isinstance(params, PathFollowerParams) else given.frame
    if given.frame not in ("", expected_frame):
        raise ValueError(f"{file}: frame: expected {expected_frame!r}, found {short(given.frame)}")
    with told_at(file):
        return make_path(given, params)


def read_drives(file: Path, params: FollowerParams, *, is_reversible: bool = False) -> tuple[list[TaughtDrive], str]:
    """Return the drives of a file of a path, one for each direction in turn, and the id of their map.

    `is_reversible`: what was taught in one direction may be driven in the other one, too. ValueError in one line.
    """
    given = read_given(file)
    with told_at(file):
        taught = make_drives(given, params)
    directions = (1, -1) if is_reversible else (1,)
    return [replace(one, direction=sign * one.direction) for one in taught for sign in directions], given.map_id


def write_course(file: Path, points: Array, map_id: str, fastest: float = UNBOUNDED) -> None:
    """Write points of `make_course` for the follower; where a speed is not known it is `fastest`, or its limits."""
    head = f"{MAP_ID} {map_id}\n" if map_id else ""
    rows = np.where(np.isfinite(points), points, fastest).tolist()
    lines = "\n".join(",".join(f"{value:.5f}" for value in row) for row in rows)
    write_whole(file, f"{head}x,y,yaw,speed\n{lines}\n")


def read_given(file: Path) -> Given:
    """Read what a file says of its points, by its ending; ValueError in one line."""
    readers = {".csv": _read_csv, ".tum": _read_tum, ".yaml": _read_yaml}
    if file.suffix not in readers:
        raise ValueError(f"{file}: expected a .csv, .tum or .yaml file, found {file.suffix or 'no ending'}")
    return readers[file.suffix](file)


def _read_tum(file: Path) -> Given:
    taught = read_tum(file)
    xy = taught.positions[:, :2]
    yaw = told_headings(xy, taught.T_map_body.quaternion)
    return Given(xy, yaw, taught_speeds(xy, taught.stamps_ns), map_id=read_map_id(file))


def _read_csv(file: Path) -> Given:
    """Return the columns by the names of a header line, else x, y[, yaw[, speed]]."""
    lines = enumerate(read_text(file, "file of points", errors="replace").split("\n"), 1)
    told = [(f"{file}:{line}", text) for line, text in lines if text.strip() and not text.startswith("#")]
    rows = [(where, [word.strip() for word in text.split(",")]) for where, text in told]
    is_headed = bool(rows) and any(word[:1].isalpha() for word in rows[0][1])
    where, order = rows.pop(0) if is_headed else (str(file), list(COLUMNS[: max(2, len(rows[0][1]) if rows else 0)]))
    if not {"x", "y"} <= set(order) <= set(COLUMNS) or len(set(order)) < len(order):
        raise ValueError(f"{where}: expected columns {', '.join(COLUMNS)}, found {short(', '.join(order))}")
    if not 1 <= len(rows) <= MAX_POINTS:
        raise ValueError(f"{file}: expected 1 to {MAX_POINTS} points, found {len(rows)}")
    table = dict(zip(order, np.array([_row(where, words, order) for where, words in rows]).T, strict=True))
    points = np.stack([table["x"], table["y"]], axis=-1)
    return Given(points, table.get("yaw"), table.get("speed"), map_id=read_map_id(file))


def _row(where: str, words: list[str], order: list[str]) -> list[float]:
    if len(words) != len(order):
        hint = ": decimal commas?" if len(words) >= 2 * len(order) else ""
        raise ValueError(f"{where}: expected {len(order)} columns, found {len(words)}{hint}")
    return [number(word, f"{where}: {name}") for name, word in zip(order, words, strict=True)]


@dataclass(frozen=True)
class _Header:
    frame_id: str = ""


@dataclass(frozen=True)
class _Position:
    x: float
    y: float


@dataclass(frozen=True)
class _Orientation:
    x: float
    y: float
    z: float
    w: float


@dataclass(frozen=True)
class _Pose:
    position: _Position
    orientation: _Orientation


@dataclass(frozen=True)
class _PoseStamped:
    pose: _Pose
    header: _Header = _Header()


@dataclass(frozen=True)
class _Path:
    poses: tuple[_PoseStamped, ...]
    header: _Header = _Header()


def _read_yaml(file: Path) -> Given:
    """Read a nav_msgs/Path as `ros2 topic echo --once` writes it; a leading slash of a frame is one of ROS 1."""
    found = load_yaml(file, read_text(file, "trajectory").rstrip().removesuffix("---"))
    poses = required(found, str(file), ("poses",))["poses"]
    if isinstance(poses, list) and poses[-1:] == ["..."]:
        raise ValueError(f"{file}: poses: expected all of them, found some cut by ros2 topic echo: use --full-length")
    path: _Path = read_as(_Path, found, str(file))
    frames = [header.frame_id.lstrip("/") for header in (path.header, *(one.header for one in path.poses))]
    frame = next(filter(None, frames), "")
    for i, own in enumerate(frames):
        if own not in ("", frame):
            where = f"{file}: poses[{i - 1}].header.frame_id"
            raise ValueError(f"{where}: expected {frame!r}, that of the path, found {short(own)}")
    xy = np.array([astuple(one.pose.position) for one in path.poses]).reshape(-1, 2)
    turns = np.array([astuple(one.pose.orientation) for one in path.poses]).reshape(-1, 4)
    for bad in np.flatnonzero(turns.any(axis=1) & (np.abs(np.linalg.norm(turns, axis=1) - 1.0) > 1e-2)):
        found = short(turns[bad].tolist())
        raise ValueError(f"{file}: poses[{bad}].orientation: expected a unit quaternion, found {found}")
    return Given(xy, told_headings(xy, turns), frame=frame)
