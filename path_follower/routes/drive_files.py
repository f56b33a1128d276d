"""Drives from files of taught paths, as the follower reads and smooths them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from path_follower.params import FollowerParams
from path_follower.path_files import read_given
from path_follower.routes.building import TaughtDrive
from path_follower.routes.network import EdgeCurve
from path_follower.taught import Given, make_path, speeds_along
from sphere_nav.geometry.files.untrusted import told_at


def read_drives(file: Path, params: FollowerParams, *, is_reversible: bool = False) -> tuple[list[TaughtDrive], str]:
    """Return the drives of a file of a path, one for each direction in turn, and the id of their map.

    `is_reversible`: what was taught in one direction may be driven in the other one, too. ValueError in one line.
    """
    given = read_given(file)
    with told_at(file):
        path = make_path(Given(*given[:3]), params)
    taught = np.full(len(given.points), np.nan) if given.speed is None else given.speed
    speed = speeds_along(given.points, taught, path.arc_length)
    columns, drives = np.stack([path.x, path.y, path.yaw, speed]), []
    for part in path.segments:
        x, y, yaw, own = columns[:, part.first : part.last + 1][:, :: part.direction]
        for direction in (part.direction, -part.direction) if is_reversible else (part.direction,):
            drives.append(TaughtDrive(EdgeCurve(x, y, np.unwrap(yaw), own), direction))
    return drives, given.map_id
