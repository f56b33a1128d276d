"""Rolling shutter: the rows of a frame are read one after the other while the camera moves.

Pose and stamp of a frame are those of its middle row. Row v is read at the share s(v) = (v - (rows - 1) / 2) / rows of
the readout, -1/2...1/2, where the camera stands at T_world_camera @ exp(s twist); the twist (v, omega) is the motion
of the camera, in its own frame, while all rows are read. A twist of zero is a global shutter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.camera import Camera, inside
from sphere_nav.geometry.se3 import SE3
from sphere_nav.params import param, parameters

ROW_STEPS = 6  # each divides the error of the row by the rows of a readout over the image motion within it
SAME_ROW = 1e-6  # rows, a change after which the next one is rounding
MAX_READOUT_S = 0.2


@parameters
class CameraParams:
    """What camera_info does not tell of a camera."""

    readout: float = param(
        0.0, "time from reading the first row to the last, rolling shutter; 0: global", "s", low=0.0, high=MAX_READOUT_S
    )


@dataclass(frozen=True)
class FrameMotion:
    """The motion within a frame, taken to be that since the frame before: `share` is readout by time between them."""

    T_world_before: SE3
    share: float

    def twist(self, T_world_camera: SE3) -> Array:
        """Return the motion (6,) (v, omega) of the camera within a frame that it ends at a pose."""
        return (self.T_world_before.inverse() @ T_world_camera).log() * self.share


def row_share(v: ArrayLike, rows: int) -> Array:
    """Return when rows are read, as a share -1/2...1/2 of the readout."""
    return (np.asarray(v, dtype=np.float64) - 0.5 * (rows - 1)) / rows


def project_rolling(
    camera: Camera, points: ArrayLike, twist: ArrayLike, same_row: float = SAME_ROW
) -> tuple[Array, Flags]:
    """Project points (N, 3), given in the camera of the middle row, to pixels (N, 2) and whether each is inside.

    The row decides where the camera was, and that decides the row: found by fixed-point iteration, until no row changes
    by more than `same_row`.
    """
    p = np.asarray(points, dtype=np.float64)
    pixels, is_inside = camera.project(p)
    if not np.any(twist):
        return pixels, is_inside
    for _ in range(ROW_STEPS):
        share, before = np.nan_to_num(row_share(pixels[:, 1], camera.height)), pixels
        T_middle_row = SE3.exp(share[:, None] * np.asarray(twist, dtype=np.float64))
        pixels, _ = camera.project(np.einsum("nji,nj->ni", T_middle_row.rotation, p - T_middle_row.translation))
        if not np.any(np.abs(pixels - before)[:, 1] > same_row):
            break
    return pixels, inside(pixels, camera)
