"""The parameters of a camera that a drive refines, as one vector."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rig_calibration.constants import (
    CENTER_SHARE,
    DISTORTION,
    FOCAL_SHARE,
    MAP_LENS,
    MAX_TANGENT,
    READOUT_S,
)
from sphere_nav.geometry import Camera, Fisheye, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import lens_of
from sphere_nav.geometry.cameras.rolling_shutter import MAX_READOUT_S

NAMES: dict[str, tuple[str, ...]] = {
    "pinhole": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "readout"),
    "fisheye": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "readout"),
}
MAP_NAMES = ("map_fx", "map_fy", "map_cx", "map_cy", "map_k1", "map_k2")
READOUT, MAP = 8, 9  # where the readout and the errors of the map's lens stand in the vector


@dataclass(frozen=True)
class Lens:
    """A pinhole or fisheye camera with its readout time in s.

    `map_errors` (6,) are those of the lens that made the map, in tangents and by MAP_NAMES, or nothing: a map of whole
    spheres closes at 360 degrees and has none. A lens in a map of a wrong lens is wrong by as much, unless turned views
    tell them apart; so both are estimated, and the deviation of one contains the other's.
    """

    camera: Pinhole | Fisheye
    readout: float = 0.0
    map_errors: tuple[float, ...] = ()

    @staticmethod
    def of(camera: Camera, readout: float = 0.0) -> Lens:
        """Return the lens of a camera; ValueError for a model that is not refined."""
        if isinstance(camera, Fisheye):
            return Lens(camera, readout)
        if not isinstance(camera, Pinhole):
            raise ValueError(f"camera: expected pinhole or fisheye, found {camera.model}")
        if any(camera.distortion[4:]):
            raise ValueError(f"distortion: expected k1 k2 p1 p2 at most, found {camera.distortion}")
        padded = (*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:4]
        return Lens(replace(camera, distortion=padded), readout)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return NAMES[self.camera.model] + (MAP_NAMES if self.map_errors else ())

    @property
    def values(self) -> Array:
        """The parameters (P,)."""
        return np.array([*lens_of(self.camera)[:READOUT], self.readout, *self.map_errors])

    @property
    def prior_sigma(self) -> Array:
        """Standard deviations (P,) of what is known of a camera that nobody calibrated."""
        c = self.camera
        lengths = (FOCAL_SHARE * c.fx, FOCAL_SHARE * c.fy, CENTER_SHARE * c.width, CENTER_SHARE * c.width)
        return np.array([*lengths, *DISTORTION[c.model], READOUT_S, *(MAP_LENS if self.map_errors else ())])

    def moved(self, step: Array) -> Lens:
        """Return the lens with a step (P,) added; the readout stays within 0 and its limit."""
        values = (self.values + step).tolist()
        fx, fy, cx, cy, *distortion = values[:READOUT]
        camera = replace(self.camera, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))
        return Lens(camera, min(max(values[READOUT], 0.0), MAX_READOUT_S), tuple(values[MAP:]))

    def beside_map(self, is_partial: bool) -> Lens:
        """Return this lens for a map of partial spheres, whose own lens may be wrong, or of whole ones."""
        return replace(self, map_errors=(0.0,) * len(MAP_NAMES) if is_partial else ())

    def correct_map(self, points: Array) -> Array:
        """Return points (N, 3) of the map, in the axes of its lens, where they are."""
        if not self.map_errors:
            return points
        z = np.maximum(points[:, 2:], 1e-3)
        xy = np.clip(points[:, :2] / z, -MAX_TANGENT, MAX_TANGENT)
        square = np.minimum(np.sum(xy**2, axis=1, keepdims=True), MAX_TANGENT**2)
        focal, center, (k1, k2) = np.split(np.array(self.map_errors), 3)
        return points - np.hstack([z * (xy * (focal + k1 * square + k2 * square**2) + center), np.zeros_like(z)])

    def level(self, index: int) -> Camera:
        """Return the camera of a level of the pyramid."""
        camera: Camera = self.camera
        for _ in range(index):
            camera = camera.halve()
        return camera
