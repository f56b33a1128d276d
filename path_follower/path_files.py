"""Reference trajectories in files: CSV, TUM poses of a taught drive, YAML (a nav_msgs/Path, points) and GeoJSON."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from path_follower.constants import MAX_LINE_GAP, MAX_POINTS
from path_follower.params import FollowerParams, PathFollowerParams
from path_follower.path import ReferencePath
from path_follower.taught import reference_path, taught_speeds, told_headings
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import (
    load_json,
    load_yaml,
    mapping,
    number,
    numbers,
    read_text,
    required,
    short,
    told_at,
)
from sphere_nav.geometry.trajectory import read_map_id, read_tum

COLUMNS = {
    "x": ("x", "x_m", "position_x", "east_m"),
    "y": ("y", "y_m", "position_y", "north_m"),
    "yaw": ("yaw", "yaw_rad", "psi", "psi_rad", "heading"),
    "speed": ("speed", "speed_mps", "v", "vx_mps", "can_speed_mps"),
}
UNUSED = {
    *("time", "t", "t_s", "stamp", "timestamp", "s", "s_m", "z", "z_m", "position_z"),
    *("kappa", "kappa_radpm", "curvature", "yaw_rate", "ax_mps2", "w_tr_right_m", "w_tr_left_m"),
}  # columns that are known, and not needed
NAME = re.compile(r"[A-Za-z]\w*")
UNBOUNDED = 1e3  # m/s
USUAL_ORDER = ("x", "y", "yaw", "speed")
POINTS_FIELDS = ("points", "is_closed", "map_id", "frame")
CUT = "..."  # in place of what `ros2 topic echo` leaves out of a list
GEOGRAPHIC = re.compile(r"CRS\s*:?8[34]|EPSG:+4\d{3}\b|WGS\s*84", re.IGNORECASE)  # longitude, latitude: no metres


class Given(NamedTuple):
    """What a file holds: points (N, 2) m, headings (N,) rad and speeds (N,) m/s where known, and of which map.

    `deviation` (N,) m: standard deviations across the way.
    """

    points: Array
    yaw: Array | None = None
    speed: Array | None = None
    is_closed: bool = False
    map_id: str = ""
    frame: str = ""  # empty where the file does not say
    deviation: Array | None = None


def read_path(path: str | os.PathLike[str], params: FollowerParams) -> ReferencePath:
    """Read a file by its ending; ValueError in one line: file, line or field, expected, found."""
    file = Path(path)
    given = read_given(file)
    expected_frame = params.map_frame if isinstance(params, PathFollowerParams) else given.frame
    if given.frame not in ("", expected_frame):
        raise ValueError(f"{file}: frame: expected {expected_frame!r}, found {short(given.frame)}")
    with told_at(file):
        return make_path(*given[:3], params, is_closed=given.is_closed, map_id=given.map_id)


def read_given(file: Path) -> Given:
    """Read what a file says of its points, by its ending; ValueError in one line."""
    readers = {".csv": _read_csv, ".tum": _read_tum, ".yaml": _read_yaml, ".yml": _read_yaml}
    readers |= {".geojson": _read_geojson, ".json": _read_geojson}
    if file.suffix not in readers:
        expected = "a .csv, .tum, .yaml or .geojson file"
        raise ValueError(f"{file}: expected {expected}, found {file.suffix or 'no ending'}")
    return readers[file.suffix](file)


def make_path(
    points: Array,
    yaw: Array | None,
    speed: Array | None,
    params: FollowerParams,
    *,
    is_closed: bool = False,
    map_id: str = "",
) -> ReferencePath:
    """Return `reference_path` with the groups of the follower's parameters; `map_id`: of the map it was taught in."""
    path = reference_path(
        points, yaw, speed, path=params.path, driving=params.speed, vehicle=params.vehicle, is_closed=is_closed
    )
    return replace(path, map_id=map_id)


def _read_tum(file: Path) -> Given:
    taught = read_tum(file)
    xy = taught.positions[:, :2]
    yaw = told_headings(xy, taught.T_map_body.quaternion)
    deviation = None if taught.covariances is None else np.sqrt(np.maximum(taught.covariances[:, 1, 1], 0.0))
    return Given(xy, yaw, taught_speeds(xy, taught.stamps_ns), map_id=read_map_id(file), deviation=deviation)


def _read_csv(file: Path) -> Given:
    """Return the columns by the names of a header line, which may be a comment, else x, y[, yaw[, speed]]."""
    lines = enumerate(read_text(file, "file of points", errors="replace").split("\n"), 1)
    found = [(f"{file}:{line}", text) for line, text in lines if text.strip()]
    remarks = [(where, _words(text)) for where, text in found if text.startswith("#")]
    rows = [(where, _words(text)) for where, text in found if not text.startswith("#")]
    headers = [rows.pop(0)] if rows and _are_names(rows[0][1]) else remarks
    if not 1 <= len(rows) <= MAX_POINTS:
        raise ValueError(
            f"{file}: expected points{f', at most {MAX_POINTS}' * bool(rows)}, found {len(rows) or 'none'}"
        )
    width = len(rows[0][1])
    named = [line for line in headers if _are_names(line[1]) and (headers is not remarks or len(line[1]) == width)]
    order = _order(*named[0]) if named else list(USUAL_ORDER[:width])
    if not named and width > 2 and not any("." in word for _, words in rows for word in words):
        expected = f"a header line for whole numbers in {width} columns"
        raise ValueError(f"{file}: expected {expected}, found none: decimal commas?")
    table = dict(zip(order, np.array([_row(where, words, order) for where, words in rows]).T, strict=True))
    points = np.stack([table["x"], table["y"]], axis=-1)
    return Given(points, table.get("yaw"), table.get("speed"), map_id=read_map_id(file))


def _words(text: str) -> list[str]:
    """Return the words of a line, between semicolons where it has any, else commas."""
    return [word.strip(" \t\"'") for word in text.lstrip("# ").split(";" if ";" in text else ",")]


def _are_names(words: list[str]) -> bool:
    """Whether a line tells names of columns."""
    is_number = {"nan", "inf"} & {word.lower() for word in words}
    return len(words) > 1 and not is_number and all(NAME.fullmatch(word) for word in words)


def _order(where: str, names: list[str]) -> list[str]:
    """Return our name of each column, empty for those not used; ValueError for a name that is not known."""
    ours = {alias: name for name, aliases in COLUMNS.items() for alias in aliases} | dict.fromkeys(UNUSED, "")
    order = [ours.get(name.lower(), CUT) for name in names]
    used = [name for name in order if name]
    if CUT in order or not {"x", "y"} <= set(order) or len(set(used)) < len(used):
        known = "; ".join(f"{name} ({', '.join(aliases[1:])})" for name, aliases in COLUMNS.items())
        raise ValueError(f"{where}: expected columns of the names {known}, found {short(', '.join(names))}")
    return order


def _row(where: str, words: list[str], order: list[str]) -> list[float]:
    """Return the numbers of the columns that are used, NaN for the others."""
    if len(words) != max(2, len(order)):
        hint = ": decimal commas?" if len(words) >= 2 * len(order) else ""
        raise ValueError(f"{where}: expected {max(2, len(order))} columns, found {len(words)}{hint}")
    for word in words:
        if "," in word:
            raise ValueError(f"{where}: expected numbers with a decimal point, found {short(word)}")
    return [number(word, f"{where}: {field}") if field else math.nan for field, word in zip(order, words, strict=True)]


def _read_yaml(file: Path) -> Given:
    """Read `points: [[x, y, yaw, speed], ...]`, or a nav_msgs/Path as `ros2 topic echo --once` writes it."""
    text = read_text(file, "trajectory").rstrip().removesuffix("---")
    found = load_yaml(file, text)
    if isinstance(found, dict) and "poses" in found:
        return _read_poses(file, found)
    found = mapping(found, str(file), POINTS_FIELDS, POINTS_FIELDS[1:])
    rows = _rows(found["points"], f"{file}: points")
    width = len(rows[0]) if isinstance(rows[0], list) else 0
    if not 2 <= width <= len(USUAL_ORDER):
        raise ValueError(
            f"{file}: points[0]: expected [x, y], [x, y, yaw] or [x, y, yaw, speed], found {short(rows[0])}"
        )
    table = np.array([numbers(row, f"{file}: points[{i}]", width) for i, row in enumerate(rows)])
    yaw, speed = (table[:, i] if width > i else None for i in (2, 3))
    is_closed = _flag(found, "is_closed", str(file))
    map_id, frame = (_word(found, key, str(file)) for key in ("map_id", "frame"))
    return Given(table[:, :2], yaw, speed, is_closed, map_id, frame)


def _read_poses(file: Path, found: Mapping[str, Any]) -> Given:
    frame = _frame_of(found, str(file))
    places: list[list[float]] = []
    turns: list[list[float]] = []
    for i, stamped in enumerate(_rows(found["poses"], f"{file}: poses")):
        where = f"{file}: poses[{i}]"
        pose = required(required(stamped, where, ("pose",))["pose"], where, ("position", "orientation"))
        own = _frame_of(stamped, where)
        frame = frame or own
        if own not in ("", frame):
            raise ValueError(f"{where}.header.frame_id: expected {frame!r}, that of the path, found {short(own)}")
        for part, axes, rows in (("position", "xy", places), ("orientation", "xyzw", turns)):
            values = required(pose[part], f"{where}.{part}", tuple(axes))
            rows.append([number(values[axis], f"{where}.{part}.{axis}") for axis in axes])
        if any(turns[-1]) and abs(math.hypot(*turns[-1]) - 1.0) > 1e-2:
            raise ValueError(f"{where}.orientation: expected a unit quaternion, found {short(turns[-1])}")
    xy = np.array(places)
    return Given(xy, told_headings(xy, np.array(turns)), frame=frame)


def _frame_of(stamped: Mapping[str, Any], where: str) -> str:
    """Return the frame of a header, empty where it has none; a leading slash is one of ROS 1."""
    header = required(stamped.get("header", {}), f"{where}: header", ())
    return _word(header, "frame_id", where).lstrip("/")


def _read_geojson(file: Path) -> Given:
    """Read the lines of a GeoJSON in the order in which they are driven, in metres of the map.

    RFC 7946 knows longitude and latitude only: the file has to name another `crs`, as those of route graphs do. A line
    with the property `reverse` is driven backwards, one with `speed` m/s not faster than that.
    """
    found = load_json(file, read_text(file, "GeoJSON"))
    _check_crs(file, required(found, str(file), ("type",)).get("crs"))
    parts: list[tuple[Array, Array, Array]] = []
    for where, line, properties in _lines(str(file), found):
        xy = np.array([numbers(point, where)[:2] for point in _rows(line, where)])
        if xy.shape[1:] != (2,) or len(xy) < 2:
            raise ValueError(f"{where}: expected two points [x, y] or more, found {short(line)}")
        if parts and (gap := float(np.hypot(*(xy[0] - parts[-1][0][-1])))) > MAX_LINE_GAP:
            raise ValueError(f"{where}: expected a begin where the last line ends, found one {gap:.3g} m off")
        step = np.gradient(xy, axis=0)
        yaw = np.arctan2(step[:, 1], step[:, 0]) + (np.pi if _flag(properties, "reverse", where) else 0.0)
        speed = number(properties["speed"], f"{where}.speed") if "speed" in properties else UNBOUNDED
        parts.append((xy, yaw, np.full(len(xy), speed)))
    if not parts:
        raise ValueError(f"{file}: expected a LineString or a MultiLineString, found none")
    xy, yaw, speeds = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Given(xy, yaw, speeds, map_id=_word(found, "map_id", str(file)))


def _check_crs(file: Path, found: Any) -> None:
    properties = found.get("properties") if isinstance(found, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or GEOGRAPHIC.search(name):
        told = (
            f"{short(name)}: longitude and latitude" if name else "none, which means longitude and latitude (RFC 7946)"
        )
        raise ValueError(f"{file}: crs.properties.name: expected that of a frame in metres, as 'local', found {told}")


def _lines(where: str, found: Any) -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """Yield where a line stands, its coordinates and the properties of its feature; points and areas count not."""
    if found["type"] == "FeatureCollection":
        for i, feature in enumerate(_rows(required(found, where, ("features",))["features"], f"{where}: features")):
            yield from _lines(f"{where}: features[{i}]", required(feature, f"{where}: features[{i}]", ("type",)))
        return
    properties = found.get("properties") or {}
    geometry = found.get("geometry") if found["type"] == "Feature" else found
    kind = required(geometry, f"{where}: geometry", ("type",))["type"]
    if kind == "LineString":
        yield where, required(geometry, where, ("coordinates",))["coordinates"], properties
    elif kind == "MultiLineString":
        for line in _rows(required(geometry, where, ("coordinates",))["coordinates"], where):
            yield where, line, properties


def _rows(found: Any, where: str) -> list[Any]:
    if isinstance(found, list) and CUT in found:
        raise ValueError(f"{where}: expected all of them, found a list cut by ros2 topic echo: use --full-length")
    if not isinstance(found, list) or not 1 <= len(found) <= MAX_POINTS:
        raise ValueError(f"{where}: expected a list of 1 to {MAX_POINTS}, found {short(found)}")
    return found


def _word(found: Mapping[str, Any], field: str, where: str) -> str:
    if not isinstance(word := found.get(field, ""), str):
        raise ValueError(f"{where}: {field}: expected a text, found {short(word)}")
    return word


def _flag(found: Mapping[str, Any], field: str, where: str) -> bool:
    if not isinstance(flag := found.get(field, False), bool):
        raise ValueError(f"{where}: {field}: expected true or false, found {short(flag)}")
    return flag
