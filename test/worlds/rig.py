"""A textured sphere around a rig, in closed form: what a camera sees of it, and the true sphere."""

import numpy as np

from sphere_nav.geometry import SE3, Fisheye, Rig, RigCamera
from sphere_nav.geometry.cameras.camera import pixel_rays

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LENS = Fisheye(160, 160, 48.0, 48.0, 79.5, 79.5)
RADIUS = 3.0  # m, of the sphere of texture
WIDTH = 256
BASELINE = 0.3
WAVES = np.random.default_rng(0).normal(size=(24, 3)) * 9


def texture(points, phase=0.0):
    """Grey levels (...,) of directions: smooth, without period, the same for every camera."""
    rays = points / np.linalg.norm(points, axis=-1, keepdims=True)
    waves = rays.astype(np.float32) @ WAVES.T.astype(np.float32) + (np.arange(24) + phase).astype(np.float32)
    return 128.0 + 14.0 * np.sin(waves, out=waves).sum(axis=-1)


def reach_of(part):
    """Return the rays (h, w, 3) of a camera in the rig's frame and how far they go until the sphere of texture."""
    rays = np.nan_to_num(pixel_rays(part.camera), nan=0.5) @ part.T_rig_camera.rotation.T
    origin = part.T_rig_camera.translation
    along = rays @ origin
    return rays, -along + np.sqrt(along**2 + RADIUS**2 * np.sum(rays * rays, axis=-1) - origin @ origin)


def seen(part, phase=0.0):
    """Return what a camera sees (h, w) uint8; another phase is another moment of a scene that changes."""
    rays, reach = reach_of(part)
    levels = texture(part.T_rig_camera.translation + reach[..., None] * rays, phase)
    return np.clip(np.rint(levels), 1, 255).astype(np.uint8)


def depth_of(part):
    """Return the depth (h, w) float32 along the axis of a camera, NaN behind it."""
    rays, reach = reach_of(part)
    depth = reach * (rays @ part.T_rig_camera.rotation[:, 2])
    return np.where(depth > 0, depth, np.nan).astype(np.float32)


def vertical_rig(lens=LENS):
    """Return three pairs of cameras, one above the other."""
    parts = []
    for level, z in (("top", 0.5 * BASELINE), ("bottom", -0.5 * BASELINE)):
        for name, azimuth in (("front", 0.0), ("left", 2.1), ("right", -2.1)):
            pose = SE3.from_planar(0.0, 0.0, azimuth) @ SE3.from_parts(OPTICAL, [0.02, 0.0, z])
            parts.append(RigCamera(f"{level}_{name}", lens, pose, exposure_group=f"{name}", level=level))
    return Rig(tuple(parts))


def truth(stitcher, phase=0.0):
    """Return the grey levels and the range (H, W) of the true sphere."""
    rays = pixel_rays(stitcher.whole)
    z = stitcher.T_rig_sphere.translation[2]
    range_m = -rays[..., 2] * z + np.sqrt((rays[..., 2] * z) ** 2 + RADIUS**2 - z * z)
    points = rays * range_m[..., None] + stitcher.T_rig_sphere.translation
    return texture(points, phase), range_m


RIG_NAMES = vertical_rig().names
