"""The cameras on the car: lenses from what is asked of them (so many pixels, so wide a view), and their places.

Rigs have six cameras (M15 section 4.3); their frame has body axes. Vertical rig: three cameras 120 degrees apart around
a mast, three more straight below; the origin is the middle of the upper ones. Ring rig: six cameras 60 degrees apart on
a circle around the origin, neighbours one baseline apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from cycab_sim.params import CameraRigParams, ImagingParams, SimCameraParams, SphereParams
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole, Spherical
from sphere_nav.geometry.cameras.rig import Rig, RigCamera

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # body axes of optical axes
MAX_PINHOLE_DEG = 150.0  # a plane image of a wider view is nearly all edge
AROUND = {"front": 0.0, "left": 120.0, "right": -120.0}
RING = {"front": 0.0, "front_left": 60.0, "rear_left": 120.0, "rear": 180.0, "rear_right": -120.0, "front_right": -60.0}
FRAME = "rig_link"
LENGTH, ANGLE, FOCAL = 1e-3, np.radians(0.3), 3e-3  # standard deviations of mounting and making, m, rad, share
CENTER = 2.0  # of the principal point, px of an image of 544 columns
Center = tuple[float, float]
LensParams = SimCameraParams | CameraRigParams


@dataclass(frozen=True)
class Mount:
    """A camera on the car: its model, its place, its frame, whether it sees grey only, and its noise.

    T_base_camera maps camera coordinates (optical axes, body axes for a sphere) to the car's;
    `noises`: deviation of the read-out in grey levels, variance of the light over the grey level, without `imaging`;
    cameras of one group have one exposure.
    """

    name: str
    frame_id: str
    camera: Camera
    T_base_camera: SE3
    is_gray: bool
    noises: tuple[float, float]
    group: str
    imaging: ImagingParams = field(default_factory=ImagingParams)


def forward_camera(params: SimCameraParams, imaging: ImagingParams) -> Mount:
    """Return the camera for driving; the frame of a panorama has body axes."""
    camera = make_lens(params, "camera")
    is_sphere = params.model == "panorama"
    roll, pitch, yaw = np.radians(params.place[3:]).tolist()
    place = SE3.from_angles(roll, pitch, yaw, params.place[:3])
    T_base_camera = place @ SE3.from_parts(np.eye(3) if is_sphere else OPTICAL, np.zeros(3))
    frame_id = "camera_link" if is_sphere else "camera_optical"
    imaging = replace(imaging, vignetting=0.0) if is_sphere else imaging
    return Mount("camera", frame_id, camera, T_base_camera, True, params.noises, "camera", imaging)


def roof_sphere(params: SphereParams) -> tuple[Mount, ...]:
    """Return the ideal RGB-D sphere, if there is one."""
    if not params.width:
        return ()
    if params.width % 2:
        raise ValueError(f"sphere.width: expected an even number, found {params.width}")
    T_base_camera = SE3.from_parts(np.eye(3), params.place)
    camera = Spherical(params.width, params.width // 2)
    return (Mount("sphere", "sphere_link", camera, T_base_camera, False, params.noises, "sphere"),)


def make_lens(params: LensParams, name: str, scale: float = 1.0, offset: Center = (0.0, 0.0)) -> Camera:
    """Return the camera of parameters: the field of view is met at the left and right edge, distortion included.

    `name` of the group is for messages; the focal length is multiplied by `scale`, the centre moved by `offset` px.
    """
    width, height = params.columns_rows
    if params.model == "panorama":
        return panorama(width, height, name)
    if params.model == "pinhole" and params.view_deg > MAX_PINHOLE_DEG:
        raise ValueError(f"{name}.view_deg: expected at most {MAX_PINHOLE_DEG} of a pinhole, found {params.view_deg}")
    f = focal_length(params) * scale
    center = ((width - 1) / 2 + offset[0], (height - 1) / 2 + offset[1])
    if params.model == "pinhole":
        pinhole = Pinhole(width, height, f, f, *center, (*params.distortion, 0.0, 0.0, 0.0))
        camera: Camera = pinhole
        limit = 2 * math.degrees(math.atan(pinhole.max_radius))
    else:
        camera = fisheye = Fisheye(width, height, f, f, *center, (*params.distortion, 0.0, 0.0))
        limit = 2 * math.degrees(fisheye.max_radius)
    if params.view_deg > limit or f <= 0.0:
        expected = f"expected at most {limit:.0f} with this distortion"
        raise ValueError(f"{name}.view_deg: {expected}, found {params.view_deg}")
    return camera


def focal_length(params: LensParams) -> float:
    """Return the focal length in pixels with which the field of view fills the width."""
    half = math.radians(params.view_deg) / 2
    r = math.tan(half) if params.model == "pinhole" else half
    k1, k2 = params.distortion
    radius = r * (1.0 + r * r * (k1 + r * r * k2))
    return 0.5 * params.columns_rows[0] / max(radius, 1e-2)  # a lens that folds back is refused by its limit


def panorama(width: int, height: int, name: str) -> Spherical:
    """Return a sphere of `width` columns of which `height` rows around the horizon are kept."""
    if width % 2 or height % 2 or height > width // 2:
        expected = "expected even numbers, at most half as many rows as columns"
        raise ValueError(f"{name}.size: {expected}, found {width},{height}")
    if height == width // 2:
        return Spherical(width, height)
    return Spherical(width, height, float(width), 0.0, (width / 2 - height) / 2)


# --- rigs
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
