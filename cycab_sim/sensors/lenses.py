"""Camera models from what is asked of them: so many pixels, so wide a view, so much distortion."""

from __future__ import annotations

import math

from cycab_sim.params import CameraRigParams, SimCameraParams
from sphere_nav.geometry import Camera, Fisheye, Pinhole, Spherical

MAX_PINHOLE_DEG = 150.0  # a plane image of a wider view is nearly all edge
Centre = tuple[float, float]
LensParams = SimCameraParams | CameraRigParams


def make_lens(params: LensParams, name: str, scale: float = 1.0, offset: Centre = (0.0, 0.0)) -> Camera:
    """Return the camera of parameters: the field of view is met at the left and right edge, distortion included.

    `name` of the group is for messages; the focal length is multiplied by `scale`, the centre moved by `offset` px.
    """
    if params.model == "panorama":
        return panorama(params.width, params.height, name)
    if params.model == "pinhole" and params.view_deg > MAX_PINHOLE_DEG:
        raise ValueError(f"{name}.view_deg: expected at most {MAX_PINHOLE_DEG} of a pinhole, found {params.view_deg}")
    f = focal_length(params) * scale
    centre = ((params.width - 1) / 2 + offset[0], (params.height - 1) / 2 + offset[1])
    half = math.radians(params.view_deg) / 2
    if params.model == "pinhole":
        pinhole = Pinhole(params.width, params.height, f, f, *centre, (params.k1, params.k2, 0.0, 0.0, 0.0))
        is_good, limit = math.tan(half) <= pinhole.max_radius, 2 * math.atan(pinhole.max_radius)
        camera: Camera = pinhole
    else:
        camera = fisheye = Fisheye(params.width, params.height, f, f, *centre, (params.k1, params.k2, 0.0, 0.0))
        is_good, limit = half <= fisheye.max_angle, 2 * fisheye.max_angle
    if not is_good or f <= 0.0:
        raise ValueError(
            f"{name}.view_deg: expected at most {math.degrees(limit):.0f} with this distortion, found {params.view_deg}"
        )
    return camera


def focal_length(params: LensParams) -> float:
    """Return the focal length in pixels with which the field of view fills the width."""
    half = math.radians(params.view_deg) / 2
    r = math.tan(half) if params.model == "pinhole" else half
    radius = r * (1.0 + r * r * (params.k1 + r * r * params.k2))
    return 0.5 * params.width / max(radius, 1e-2)  # a lens that folds back is refused by its limit


def panorama(width: int, height: int, name: str) -> Spherical:
    """Return a sphere of `width` columns of which `height` rows around the horizon are kept."""
    if width % 2 or height % 2 or height > width // 2:
        expected = "expected even numbers, at most half as many rows as columns"
        raise ValueError(f"{name}.width, height: {expected}, found {width} x {height}")
    if height == width // 2:
        return Spherical(width, height)
    return Spherical(width, height, float(width), 0.0, (width / 2 - height) / 2)
