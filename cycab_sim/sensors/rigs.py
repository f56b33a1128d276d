"""The rigs of six cameras (M15 section 4.3): three stereo pairs back to back, or a ring of diverging cameras.

The rig's frame has body axes. Vertical rig: three cameras 120 degrees apart around a mast, three more straight below;
the origin is the middle of the upper ones. Ring rig: six cameras 60 degrees apart on a circle around the origin,
neighbours one baseline apart.
"""

from __future__ import annotations

import numpy as np

from cycab_sim.params import CameraRigParams, ImagingParams
from cycab_sim.sensors.cameras import OPTICAL, Mount, make_lens
from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.rig import Rig, RigCamera

AROUND = {"front": 0.0, "left": 120.0, "right": -120.0}
RING = {"front": 0.0, "front_left": 60.0, "rear_left": 120.0, "rear": 180.0, "rear_right": -120.0, "front_right": -60.0}
FRAME = "rig_link"
LENGTH, ANGLE, FOCAL = 1e-3, np.radians(0.3), 3e-3  # standard deviations of mounting and making, m, rad, share
CENTER = 2.0  # of the principal point, px of an image of 544 columns


def rig_camera_names(kind: str) -> tuple[str, ...]:
    """Return the names of a rig's cameras; none of the kind `none`."""
    if kind == "vertical":
        return tuple(f"{level}_{name}" for level in ("top", "bottom") for name in AROUND)
    return tuple(RING) if kind == "ring" else ()


def make_rig(params: CameraRigParams, seed: int) -> Rig | None:
    """Return the rig as it is truly built, every camera a little off its plan; None of the kind `none`."""
    if params.kind == "none":
        return None
    rng = np.random.default_rng([seed, 41])
    cameras = tuple(_make_camera(params, name, rng) for name in rig_camera_names(params.kind))
    return Rig(cameras, name=f"{params.kind}_{seed}")


def rig_mounts(params: CameraRigParams, imaging: ImagingParams, rig: Rig | None) -> tuple[Mount, ...]:
    """Return the cameras of a rig on the car."""
    T_base_rig = rig_place(params)
    return tuple(
        Mount(c.name, f"{c.name}_optical", c.camera, T_base_rig @ c.T_rig_camera, False, params.noises, "rig", imaging)
        for c in (rig.cameras if rig else ())
    )


def rig_place(params: CameraRigParams) -> SE3:
    """Return T_base_rig."""
    return SE3.from_parts(np.eye(3), params.place)


def planned_pose(params: CameraRigParams, name: str) -> SE3:
    """Return T_rig_camera by the plan: optical axes, looking away from the middle."""
    level, _, rest = name.partition("_")
    is_vertical = params.kind == "vertical"
    azimuth = np.radians(AROUND[rest] if is_vertical else RING[name])
    radius = params.radius if is_vertical else params.baseline  # a hexagon's side is its radius
    height = -params.baseline if is_vertical and level == "bottom" else 0.0
    away = SE3.from_angles(0.0, 0.0, float(azimuth), [0.0, 0.0, height])
    return away @ SE3.from_parts(OPTICAL, [radius, 0.0, 0.0])


def _make_camera(params: CameraRigParams, name: str, rng: np.random.Generator) -> RigCamera:
    off = params.tolerance * rng.standard_normal(9)
    du, dv = CENTER * params.columns_rows[0] / 544 * off[7:]
    lens = make_lens(params, "rig", float(1.0 + FOCAL * off[6]), (float(du), float(dv)))
    error = SE3.exp(off[:6] * ([LENGTH] * 3 + [ANGLE] * 3))
    level = name.partition("_")[0] if params.kind == "vertical" else ""
    return RigCamera(name, lens, planned_pose(params, name) @ error, exposure_group="rig", level=level)
