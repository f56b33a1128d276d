"""Where a rig's spheres are, and its views from there, computed once for every set of cameras that deliver."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from sphere_mapping.acquisition.constants import MIN_BASELINE_M, NUM_BANDS
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.views import Layout, RigView, border_of, layout_of
from sphere_nav.geometry import SE3, Rig, RigCamera, Spherical
from sphere_nav.geometry.arrays import Array, Bytes

MAX_LAYOUTS = 8  # sets of cameras whose tables are kept


class Layouts:
    """The tables of a rig. `T_rig_sphere` is where its spheres are, `baseline_m` how far above its bottom spheres."""

    def __init__(self, rig: Rig, params: StitchParams, masks: Mapping[str, Bytes]) -> None:
        align = max(64, 2 << NUM_BANDS)
        if params.width % align:
            raise ValueError(f"stitch.width: expected a multiple of {align}, found {params.width}")
        self.rig, self._blend = rig, params.blend
        self.whole = Spherical(params.width, params.width // 2)
        self.T_rig_sphere, self.baseline_m = sphere_frame(rig)
        T_sphere_rig = self.T_rig_sphere.inverse()
        self.views = {
            part.name: RigView(
                part.name, part.camera, T_sphere_rig @ part.T_rig_camera, border_of(part, masks.get(part.name))
            )
            for part in rig.cameras
        }
        self._kept: Callable[[str, tuple[str, ...]], Layout] = lru_cache(MAX_LAYOUTS)(self._make)

    def of(self, level: str, present: Sequence[str]) -> Layout:
        """Return the views of a level's cameras that are present; ValueError if there are none."""
        names = tuple(part.name for part in self.rig.at_level(level) if part.name in present)
        if not names:
            raise ValueError(f"rig {self.rig.name}: expected an image of a {level or 'rig'} camera, found none")
        return self._kept(level, names)

    def _make(self, level: str, names: tuple[str, ...]) -> Layout:
        rig_views = [self._view_at(self.views[name], level) for name in names]
        return layout_of(rig_views, self.whole, self._blend.distance_m, NUM_BANDS)

    def _view_at(self, rig_view: RigView, level: str) -> RigView:
        """Return the rig_view as seen from the centre of its level."""
        if level != "bottom":
            return rig_view
        T_sphere_camera = rig_view.T_sphere_camera
        from_bottom = T_sphere_camera.translation + np.array([0.0, 0.0, self.baseline_m])
        return replace(rig_view, T_sphere_camera=SE3.from_parts(T_sphere_camera.rotation, from_bottom))


def center_of(cameras: Sequence[RigCamera]) -> Array:
    """Return the mean of the cameras' centres (3,) in the frame of the rig."""
    return np.mean([camera.T_rig_camera.translation for camera in cameras], axis=0)


def sphere_frame(rig: Rig) -> tuple[SE3, float]:
    """Return T_rig_sphere and the vertical baseline in m, 0 for a rig of one level.

    A vertical rig's sphere lies in the middle of its top cameras; its z axis points there from the middle of the bottom
    ones, so that a point has the same column in both spheres. Its x axis is the rig's, as nearly as possible.
    """
    if not rig.is_vertical:
        return SE3.from_parts(np.eye(3), center_of(rig.cameras)), 0.0
    top, bottom = center_of(rig.at_level("top")), center_of(rig.at_level("bottom"))
    baseline_m = float(np.linalg.norm(top - bottom))
    if baseline_m < (least := MIN_BASELINE_M["levels"]):
        raise ValueError(f"rig {rig.name}: expected levels at least {least} m apart, found {baseline_m:.4f} m")
    if top[2] <= bottom[2]:
        raise ValueError(
            f"rig {rig.name}: level: expected top above bottom along z, found {top[2]:.3f}, {bottom[2]:.3f}"
        )
    return SE3.from_parts(upright((top - bottom) / baseline_m, np.array([1.0, 0.0, 0.0])), top), baseline_m


def upright(z: Array, forward: Array) -> Array:
    """Return the rotation whose z axis is the unit vector z and whose x axis is nearest to `forward`."""
    x = forward - z * (z @ forward)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
