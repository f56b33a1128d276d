"""A sphere of about a hundred rows: what is kept of all spheres of a map, to find one's place among them."""

from __future__ import annotations

from typing import cast
from weakref import WeakKeyDictionary

import cv2
import numpy as np

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Floats
from sphere_nav.geometry.cameras.spherical import level_cameras
from sphere_nav.spheres.constants import MIN_COARSE_SIDE, SURFACE_RATIO
from sphere_nav.spheres.sphere import UNSEEN, Sphere

_known: WeakKeyDictionary[Sphere, Sphere] = WeakKeyDictionary()  # as long as the large ones are


def coarse_sphere(sphere: Sphere) -> Sphere:
    """Return the grey sphere, halved while no side gets shorter than `MIN_COARSE_SIDE`; kept with the large one."""
    small = _known.get(sphere)
    if small is None:
        small = _known[sphere] = _halved(sphere)
    return small


def _halved(sphere: Sphere) -> Sphere:
    cameras = level_cameras(sphere.camera, MIN_COARSE_SIDE)
    camera, factor = cast(Spherical, cameras[-1]), 2 ** (len(cameras) - 1)
    height, width = camera.height * factor, camera.width * factor
    gray = cv2.resize(sphere.gray[:height, :width], (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    image: Bytes = np.clip(np.rint(gray), UNSEEN + 1, 255).astype(np.uint8)
    return Sphere(image, nearest_surface(sphere.range_m[:height, :width], factor), camera, sphere.stamp_ns)


def nearest_surface(range_m: Floats, factor: int) -> Floats:
    """Return the mean inverse range of the nearest surface in each block, NaN where nothing is known of it."""
    height, width = range_m.shape[0] // factor, range_m.shape[1] // factor
    blocks: Floats = range_m.reshape(height, factor, width, factor).transpose(0, 2, 1, 3)
    blocks = blocks.reshape(height, width, factor * factor)
    nearest = np.fmin.reduce(blocks, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_near = blocks <= SURFACE_RATIO * nearest[..., None]
        inverse = np.where(is_near, 1.0 / blocks, 0.0).sum(axis=2) / is_near.sum(axis=2)
        return np.where(np.isnan(nearest), np.nan, 1.0 / inverse).astype(np.float32)
