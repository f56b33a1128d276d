"""Cameras as vectors (fx, fy, cx, cy, distortion...) of one length for all models.

omni: k1 k2 p1 p2, k3 = 0, xi.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Array, Flags, Size
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import Omni
from sphere_nav.geometry.cameras.pinhole import Fisheye, Pinhole

NUM_LENS = 12  # fx fy cx cy and up to eight coefficients
K3, XI = 8, 9  # of an omni
MODELS: dict[str, Any] = {model.model: model for model in (Pinhole, Fisheye, Omni)}


def lens_of(camera: Camera) -> Array:
    """Return the parameters (12,) of a camera of one of the models, zeros behind its own."""
    if not isinstance(camera, Pinhole | Fisheye | Omni):
        raise ValueError(f"model: expected one of {', '.join(MODELS)}, found {camera.model!r}")
    own = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]
    found = np.concatenate([own, np.zeros(NUM_LENS - len(own))])
    if isinstance(camera, Omni):
        found[XI] = camera.xi
    return found


def first_lens(model: str, focal: float, center: tuple[float, float]) -> Array:
    """Return the parameters (12,) that an adjustment starts from; focal in pixels per radian on the axis."""
    found = np.array([focal, focal, *center, *np.zeros(NUM_LENS - 4)])
    if model == "omni":
        found[:2], found[XI] = 2.0 * focal, 1.0
    return found


def camera_of(model: str, size: Size, lens: Array, num_distortion: int) -> Camera:
    """Return the camera of a parameter vector; a pinhole keeps its first `num_distortion` coefficients."""
    values = lens.tolist()
    k = tuple(values[4 : 4 + (num_distortion if model == "pinhole" else 4)])
    camera: Camera = MODELS[model](*size, *values[:4], distortion=k, **({"xi": values[XI]} if model == "omni" else {}))
    return camera


def free_parameters(model: str, num_distortion: int) -> Flags:
    """Return which of the 12 parameters a model has."""
    number = np.arange(NUM_LENS)
    if model == "omni":
        return np.asarray((number <= XI) & (number != K3))
    return np.asarray(number < 4 + (num_distortion if model == "pinhole" else 4))
