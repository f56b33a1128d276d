"""Reference trajectories in files: CSV with or without a header, TUM poses of a taught drive."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from path_follower.constants import MAX_POINTS
from path_follower.params import FollowerParams
from path_follower.path import ReferencePath
from path_follower.taught import reference_path, taught_speeds
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import number, read_text
from sphere_nav.geometry.trajectory import read_map_id, read_tum

COLUMNS = {
    "x": ("x", "x_m", "position_x", "east_m"),
    "y": ("y", "y_m", "position_y", "north_m"),
    "yaw": ("yaw", "yaw_rad", "psi", "psi_rad", "heading"),
    "speed": ("speed", "speed_mps", "v", "vx_mps", "can_speed_mps"),
}
USUAL_ORDER = ("x", "y", "yaw", "speed")


class Columns(NamedTuple):
    """Points (N, 2), headings (N,), speeds (N,) and standard deviations across the way (N,), where a file has them."""

    points: Array
    yaw: Array | None
    speed: Array | None
    deviation: Array | None = None


def read_path(path: str | os.PathLike[str], params: FollowerParams, *, is_closed: bool = False) -> ReferencePath:
    """Read a `.csv` or `.tum` file; ValueError in one line: file, line, field, expected, found."""
    file = Path(path)
    columns = read_columns(file)
    try:
        return make_path(*columns[:3], params, is_closed=is_closed, map_id=read_map_id(file))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def read_columns(file: Path) -> Columns:
    """Read what a `.csv` or `.tum` file says of its points; ValueError in one line."""
    if file.suffix == ".tum":
        taught = read_tum(file)
        xy = taught.positions[:, :2]
        deviation = None if taught.covariances is None else np.sqrt(np.maximum(taught.covariances[:, 1, 1], 0.0))
        return Columns(xy, np.asarray(taught.T_map_body.yaw), taught_speeds(xy, taught.stamps_ns), deviation)
    if file.suffix == ".csv":
        return Columns(*_read_csv(file))
    raise ValueError(f"{file}: expected a .csv or .tum file, found {file.suffix or 'no ending'}")


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


def _read_csv(file: Path) -> tuple[Array, Array | None, Array | None]:
    """Return points, headings and speeds; columns by the names of a header line, else x, y[, yaw[, speed]]."""
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
    return np.stack([table["x"], table["y"]], axis=-1), table.get("yaw"), table.get("speed")


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
