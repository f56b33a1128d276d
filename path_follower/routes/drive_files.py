"""Drives from files of taught paths, as the follower reads and smooths them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from path_follower.params import FollowerParams
from path_follower.path_files import read_given
from path_follower.routes.building import TaughtDrive
from path_follower.routes.network import EdgeCurve
from path_follower.taught import make_path
from sphere_nav.geometry.arrays import Array, arc_lengths
from sphere_nav.geometry.files.untrusted import told_at


def read_drives(file: Path, params: FollowerParams, *, is_reversible: bool = False) -> tuple[list[TaughtDrive], str]:
    """Return the drives of a file of a path, one for each direction in turn, and the id of their map.

    `is_reversible`: what was taught in one direction may be driven in the other one, too. ValueError in one line.
    """
    given = read_given(file)
    with told_at(file):
        path = make_path(given.points, given.yaw, given.speed, params)
    speed = _along(given.speed, given.points, path.arc_length)
    drives = []
    for part in path.segments:
        order = slice(part.first, part.last + 1)
        rows = np.stack([path.x, path.y, path.yaw, speed], axis=-1)[order][:: part.direction]
        x, y, yaw, taught = rows.T
        for direction in (part.direction, -part.direction) if is_reversible else (part.direction,):
            drives.append(TaughtDrive(EdgeCurve(x, y, np.unwrap(yaw), taught), direction))
    return drives, given.map_id


def _along(values: Array | None, points: Array, arc: Array) -> Array:
    """Return values (N,) of points (N, 2) at arc lengths of the smooth path through them; NaN where there are none."""
    if values is None or not np.isfinite(values).any():
        return np.full(len(arc), np.nan)
    way = arc_lengths(points)
    known = np.isfinite(values)
    return np.interp(arc * way[-1] / max(float(arc[-1]), 1e-9), way[known], values[known])
