"""A camera rig: several cameras that are fixed to one another, for spheres (M15 section 4.3)."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.se3 import SE3

LEVELS = ("top", "bottom", "")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")  # a camera's name is part of its topic
T_BODY_OPTICAL = SE3.from_parts([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], np.zeros(3))
"""A camera that looks along +x, level, at the origin of body axes."""


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera of a rig.

    T_rig_camera takes optical coordinates (z forward) to those of the rig (body axes: x forward, y left, z up).
    mask: path of an image of the camera's size, 0 where the camera sees the vehicle or nothing; None without.
    exposure_group: cameras of one group share exposure and white balance, so that they share one gain.
    level: "top" or "bottom" in a rig whose cameras make two spheres with a vertical baseline; "" in one sphere.
    """

    name: str
    camera: Camera
    T_rig_camera: SE3
    mask: str | None = None
    exposure_group: str = ""
    level: str = ""

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name):
            raise ValueError(f"camera name: expected letters, digits and _ (part of a topic), found {self.name!r}")
        if self.level not in LEVELS:
            raise ValueError(f"{self.name}: level: expected top, bottom or nothing, found {self.level!r}")
        if self.T_rig_camera.matrix.shape != (4, 4) or not np.all(np.isfinite(self.T_rig_camera.matrix)):
            found = self.T_rig_camera.matrix.tolist()
            raise ValueError(f"{self.name}: T_rig_camera: expected one finite pose, found {found}")


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras in the frame of the rig; `version` tells calibrations of the same rig apart (a date, a number)."""

    cameras: tuple[RigCamera, ...]
    name: str = "rig"
    version: str = "1"

    def __post_init__(self) -> None:
        if not self.cameras:
            raise ValueError(f"rig {self.name}: cameras: expected at least one, found none")
        names = [camera.name for camera in self.cameras]
        if len(set(names)) < len(names):
            raise ValueError(f"rig {self.name}: cameras: expected different names, found {', '.join(names)}")
        found = {camera.level for camera in self.cameras}
        if found not in ({""}, {"top", "bottom"}):
            words = ", ".join(f"{camera.name} {camera.level or 'none'}" for camera in self.cameras)
            raise ValueError(
                f"rig {self.name}: level: expected top and bottom, or none for every camera, found {words}"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the cameras, in order."""
        return tuple(camera.name for camera in self.cameras)

    @property
    def is_vertical(self) -> bool:
        """Whether the cameras make a top and a bottom sphere."""
        return any(camera.level for camera in self.cameras)

    def camera(self, name: str) -> RigCamera:
        """Return the camera of this name."""
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise ValueError(f"rig {self.name}: expected a camera {name}, found {', '.join(self.names)}")

    def at_level(self, level: str) -> tuple[RigCamera, ...]:
        """Return the cameras of one level, in order."""
        return tuple(camera for camera in self.cameras if camera.level == level)
