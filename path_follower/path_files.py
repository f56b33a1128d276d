"""Reference trajectories in files: CSV, TUM poses of a taught drive, YAML (a nav_msgs/Path, points) and GeoJSON."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from path_follower.constants import MAX_LINE_GAP, MAX_POINTS
from path_follower.params import FollowerParams, PathFollowerParams
from path_follower.path import ReferencePath
from path_follower.taught import Given, make_path, taught_speeds, told_headings
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import (
    load_json,
    load_yaml,
    mapping,
    number,
    read_as,
    read_text,
    required,
    short,
    told_at,
)
from sphere_nav.geometry.trajectory import read_map_id, read_tum

COLUMNS = ("x", "y", "yaw", "speed")  # of a .csv, and of points in a .yaml
POINTS_FIELDS = ("points", "is_closed", "map_id", "frame")
UNBOUNDED = 1e3  # m/s
GEOGRAPHIC = re.compile(r"CRS\s*:?8[34]|EPSG:+4\d{3}\b|WGS\s*84", re.IGNORECASE)  # longitude, latitude: no metres
Line = tuple[tuple[float, ...], ...]


def read_path(path: str | os.PathLike[str], params: FollowerParams) -> ReferencePath:
    """Read a file by its ending; ValueError in one line: file, line or field, expected, found."""
    file = Path(path)
    given = read_given(file)
    expected_frame = params.map_frame if isinstance(params, PathFollowerParams) else given.frame
    if given.frame not in ("", expected_frame):
        raise ValueError(f"{file}: frame: expected {expected_frame!r}, found {short(given.frame)}")
    with told_at(file):
        return make_path(given, params)


def read_given(file: Path) -> Given:
    """Read what a file says of its points, by its ending; ValueError in one line."""
    readers = {".csv": _read_csv, ".tum": _read_tum, ".yaml": _read_yaml, ".yml": _read_yaml}
    readers |= {".geojson": _read_geojson, ".json": _read_geojson}
    if file.suffix not in readers:
        expected = "a .csv, .tum, .yaml or .geojson file"
        raise ValueError(f"{file}: expected {expected}, found {file.suffix or 'no ending'}")
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
class _Points:
    points: Line
    is_closed: bool = False
    map_id: str = ""
    frame: str = ""


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
    """Read `points: [[x, y, yaw, speed], ...]`, or a nav_msgs/Path as `ros2 topic echo --once` writes it."""
    found = load_yaml(file, read_text(file, "trajectory").rstrip().removesuffix("---"))
    if isinstance(found, dict) and "poses" in found:
        return _read_poses(file, read_as(_Path, found, str(file)))
    given: _Points = read_as(_Points, mapping(found, str(file), POINTS_FIELDS, POINTS_FIELDS[1:]), str(file))
    widths = set(map(len, given.points))
    if len(widths) != 1 or not widths <= {2, 3, 4}:
        expected = "rows [x, y], [x, y, yaw] or [x, y, yaw, speed]"
        raise ValueError(f"{file}: points: expected {expected}, found {short(given.points)}")
    columns = np.array(given.points).T
    yaw, speed, *_ = *columns[2:], None, None
    return Given(columns[:2].T, yaw, speed, given.is_closed, given.map_id, given.frame)


def _read_poses(file: Path, path: _Path) -> Given:
    """Return positions, and headings where they are told; a leading slash of a frame is one of ROS 1."""
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


@dataclass(frozen=True)
class _Named:
    name: str = ""


@dataclass(frozen=True)
class _Crs:
    properties: _Named = _Named()


@dataclass(frozen=True)
class _Head:
    type: str
    crs: _Crs = _Crs()
    map_id: str = ""


@dataclass(frozen=True)
class _Properties:
    speed: float = UNBOUNDED
    reverse: bool = False


def _read_geojson(file: Path) -> Given:
    """Read the lines of a GeoJSON in the order in which they are driven, in metres of the map.

    RFC 7946 knows longitude and latitude only: the file has to name another `crs`, as those of route graphs do. A line
    with the property `reverse` is driven backwards, one with `speed` m/s not faster than that.
    """
    found = load_json(file, read_text(file, "GeoJSON"))
    head: _Head = read_as(_Head, found, str(file))
    name = head.crs.properties.name
    if not name or GEOGRAPHIC.search(name):
        told = f"{short(name)}: longitude and latitude" if name else "none: longitude and latitude (RFC 7946)"
        raise ValueError(f"{file}: crs.properties.name: expected that of a frame in metres, as 'local', found {told}")
    parts: list[tuple[Array, Array, Array]] = []
    for where, line, properties in _lines(str(file), found):
        if len(line) < 2 or min(map(len, line)) < 2:
            raise ValueError(f"{where}: expected two points [x, y] or more, found {short(line)}")
        xy = np.array([point[:2] for point in line])
        if parts and (gap := float(np.hypot(*(xy[0] - parts[-1][0][-1])))) > MAX_LINE_GAP:
            raise ValueError(f"{where}: expected a begin where the last line ends, found one {gap:.3g} m off")
        step = np.gradient(xy, axis=0)
        yaw = np.arctan2(step[:, 1], step[:, 0]) + (np.pi if properties.reverse else 0.0)
        parts.append((xy, yaw, np.full(len(xy), properties.speed)))
    if not parts:
        raise ValueError(f"{file}: expected a LineString or a MultiLineString, found none")
    xy, yaw, speeds = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Given(xy, yaw, speeds, map_id=head.map_id)


def _lines(where: str, found: Any) -> Iterator[tuple[str, Line, _Properties]]:
    """Yield where a line stands, its coordinates and the properties of its feature; points and areas count not."""
    if found["type"] == "FeatureCollection":
        features = required(found, where, ("features",))["features"]
        for i, feature in enumerate(features if isinstance(features, list) else ()):
            yield from _lines(f"{where}: features[{i}]", required(feature, f"{where}: features[{i}]", ("type",)))
        return
    properties: _Properties = read_as(_Properties, found.get("properties") or {}, where)
    geometry = required(found.get("geometry", found), f"{where}: geometry", ("type", "coordinates"))
    if geometry["type"] == "LineString":
        yield where, read_as(Line, geometry["coordinates"], where), properties
    elif geometry["type"] == "MultiLineString":
        for line in read_as(tuple[Line, ...], geometry["coordinates"], where):
            yield where, line, properties
