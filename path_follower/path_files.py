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
from path_follower.taught import reference_path, taught_speeds
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import (
    load_json,
    load_yaml,
    number,
    numbers,
    read_text,
    required,
    short,
)
from sphere_nav.geometry.trajectory import read_map_id, read_tum

COLUMNS = {
    "x": ("x", "x_m", "position_x", "east_m"),
    "y": ("y", "y_m", "position_y", "north_m"),
    "yaw": ("yaw", "yaw_rad", "psi", "psi_rad", "heading"),
    "speed": ("speed", "speed_mps", "v", "vx_mps", "can_speed_mps"),
}
UNBOUNDED = 1e3  # m/s
USUAL_ORDER = ("x", "y", "yaw", "speed")
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


def read_path(path: str | os.PathLike[str], params: FollowerParams, *, is_closed: bool = False) -> ReferencePath:
    """Read a file by its ending; ValueError in one line: file, line or field, expected, found."""
    file = Path(path)
    given = read_given(file)
    expected_frame = params.map_frame if isinstance(params, PathFollowerParams) else given.frame
    if given.frame not in ("", expected_frame):
        raise ValueError(f"{file}: frame: expected {expected_frame!r}, found {short(given.frame)}")
    try:
        is_ring = is_closed or given.is_closed
        return make_path(given.points, given.yaw, given.speed, params, is_closed=is_ring, map_id=given.map_id)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


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
    yaw = np.asarray(taught.T_map_body.yaw)
    deviation = None if taught.covariances is None else np.sqrt(np.maximum(taught.covariances[:, 1, 1], 0.0))
    return Given(xy, yaw, taught_speeds(xy, taught.stamps_ns), map_id=read_map_id(file), deviation=deviation)


def _read_csv(file: Path) -> Given:
    """Return the columns by the names of a header line, else x, y[, yaw[, speed]]."""
    order: list[str] = []
    rows: list[list[float]] = []
    for line, text in enumerate(read_text(file, "file of points", errors="replace").split("\n"), 1):
        words = [word.strip() for word in text.lstrip("# ").strip().split(",")]
        is_header = not rows and any(word[:1].isalpha() and word.lower() not in ("nan", "inf") for word in words)
        if is_header:
            order = _order(words) or order
        elif text.strip() and not text.startswith("#"):
            rows.append(_row(f"{file}:{line}", words, order or list(USUAL_ORDER[: len(words)])))
            if len(rows) > MAX_POINTS or len(rows[-1]) != len(rows[0]):
                limit = f"{len(rows[0])} columns and at most {MAX_POINTS} points"
                raise ValueError(f"{file}:{line}: expected {limit}, found {len(rows[-1])} and {len(rows)}")
    if not rows:
        raise ValueError(f"{file}: expected points, found none")
    order = order or list(USUAL_ORDER[: len(rows[0])])
    table = dict(zip(order, np.array(rows).T, strict=False))
    table.pop("", None)
    points = np.stack([table["x"], table["y"]], axis=-1)
    return Given(points, table.get("yaw"), table.get("speed"), map_id=read_map_id(file))


def _order(names: list[str]) -> list[str]:
    """Return our name of each column, empty for those not used; nothing if these are not names of columns."""
    ours = {alias: name for name, aliases in COLUMNS.items() for alias in aliases}
    order = [ours.get(name.lower(), "") for name in names]
    return order if "x" in order and "y" in order else []


def _row(where: str, words: list[str], order: list[str]) -> list[float]:
    """Return the numbers of the columns that are used, NaN for the others."""
    if len(words) < max(2, len(order)):
        raise ValueError(f"{where}: expected {max(2, len(order))} columns, found {len(words)}")
    return [number(word, f"{where}: {field}") if field else math.nan for field, word in zip(order, words, strict=False)]


def _read_yaml(file: Path) -> Given:
    """Read `points: [[x, y, yaw, speed], ...]`, or a nav_msgs/Path as `ros2 topic echo --once` writes it."""
    text = read_text(file, "trajectory").rstrip().removesuffix("---")
    found = load_yaml(file, text)
    if isinstance(found, dict) and "poses" in found:
        return _read_poses(file, found)
    rows = _rows(required(found, str(file), ("points",))["points"], f"{file}: points")
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
    rows = []
    for i, stamped in enumerate(_rows(found["poses"], f"{file}: poses")):
        where = f"{file}: poses[{i}]"
        pose = required(required(stamped, where, ("pose",))["pose"], where, ("position", "orientation"))
        x, y = (
            number(required(pose["position"], where, ("x", "y"))[axis], f"{where}.position.{axis}") for axis in "xy"
        )
        turn = required(pose["orientation"], where, tuple("xyzw"))
        qx, qy, qz, qw = (number(turn[axis], f"{where}.orientation.{axis}") for axis in "xyzw")
        if abs(math.hypot(qx, qy, qz, qw) - 1.0) > 1e-2:
            raise ValueError(f"{where}.orientation: expected a unit quaternion, found {short([qx, qy, qz, qw])}")
        rows.append((x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))))
    table, header = np.array(rows), required(found.get("header", {}), f"{file}: header", ())
    return Given(table[:, :2], table[:, 2], frame=_word(header, "frame_id", str(file)))


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
