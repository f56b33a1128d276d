"""Paths that are driven in a map without having been taught: back, and a turn in three moves (M15 fig. 14)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cycab_sim.world.paths import arc
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory

TURN_RADIUS, THIRD = 3.5, np.pi / 3  # m, rad: of each of the three moves; the Cycab can turn within 2.5 m
MOVES = ((1.0, 1.0), (-1.0, -1.0), (1.0, 1.0))  # gear, and side to which the wheels are turned
SPACING = 0.1  # m between the points of a move
SPEED, TURN_SPEED = 1.0, 0.5  # m/s


def planar(trajectory: Trajectory) -> Array:
    """Return x, y, yaw (N, 3) in m and rad."""
    return np.column_stack([trajectory.positions[:, :2], np.atleast_1d(trajectory.T_map_body.yaw)])


def turn_around(poses: Array) -> tuple[Array, Array]:
    """Return poses (M, 3) and speeds (M,) m/s: along poses (N, 3), a turn in three moves at the last, and back.

    The moves end where they began, facing the other way.
    """
    parts = [poses]
    for gear, side in MOVES:
        way = np.append(np.arange(SPACING, TURN_RADIUS * THIRD, SPACING), TURN_RADIUS * THIRD)
        parts.append(arc(parts[-1][-1], gear * way, side / TURN_RADIUS))
    back = poses[:-1][::-1] + np.array([0.0, 0.0, np.pi])
    count = sum(map(len, parts[1:]))
    speeds = np.concatenate([np.full(len(poses), SPEED), np.full(count, TURN_SPEED), np.full(len(back), SPEED)])
    return np.concatenate([*parts, back]), speeds


def write_plan(path: Path, poses: Array, speeds: Array) -> Path:
    """Write poses (N, 3) and speeds (N,) as the follower reads them; return the path of the file."""
    rows = "".join(f"{x:.6f},{y:.6f},{yaw:.6f},{speed:.3f}\n" for (x, y, yaw), speed in zip(poses, speeds, strict=True))
    path.write_text("x,y,yaw,speed\n" + rows, encoding="ascii")
    return path
