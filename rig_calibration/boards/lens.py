"""Cameras as parameter vectors: (fx, fy, cx, cy, distortion...), padded to one length for all models.

omni: k1 k2 p1 p2, k3 = 0, xi. ocam: b2 b3 b4 and s, in units of f = h0: a ray (q, 1 + b2 r^2 + b3 r^3 + b4 r^4) with
r = |q| is seen at (fx qx, fy (qy + s qx)); a turn of A about the axis would be one of the camera, so that its e is 0.

The projection is that of `sphere_nav.geometry`, without its limit to the image and to monotonic distortion: on its way
the adjustment may pass through lenses that fold back outside of what was seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera, Fisheye, OCam, Omni, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import NEWTON_STEPS
from sphere_nav.geometry.cameras.omni import MAX_XI
from sphere_nav.geometry.cameras.pinhole import MIN_DEPTH

NUM_LENS = 12  # fx fy cx cy and up to eight coefficients
K3, XI = 8, 9  # of an omni; b2 b3 b4 s of an ocam stand from 4 on
MODELS = ("pinhole", "fisheye", "omni", "ocam")
OCAM_DEGREE = 4  # as OCamCalib's own default
EQUIDISTANT = (-1 / 3, 0.0, -1 / 45)  # b2 b3 b4: r cot r, by its series


def lens_of(camera: Camera) -> Array:
    """Return the parameters (12,) of a camera of one of the models, zeros behind its own."""
    if isinstance(camera, Pinhole | Fisheye | Omni):
        own = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]
    elif isinstance(camera, OCam) and camera.e == 0.0 and len(camera.polynomial) == OCAM_DEGREE + 1:
        f = camera.polynomial[0]
        powers = [h * f ** (power - 1) for power, h in enumerate(camera.polynomial)]
        own = [f, f * camera.c, camera.cx, camera.cy, *powers[2:], camera.d / camera.c]
    else:
        raise ValueError(f"model: expected one of {', '.join(MODELS)} (ocam: degree 4, e = 0), found {camera.model!r}")
    found = np.concatenate([own, np.zeros(NUM_LENS - len(own))])
    if isinstance(camera, Omni):
        found[XI] = camera.xi
    return found


def first_lens(model: str, focal: float, center: tuple[float, float]) -> Array:
    """Return the parameters (12,) that an adjustment starts from; focal in pixels per radian on the axis."""
    found = np.array([focal, focal, *center, *np.zeros(NUM_LENS - 4)])
    if model == "omni":
        found[:2], found[XI] = 2.0 * focal, 1.0
    elif model == "ocam":
        found[4:7] = EQUIDISTANT
    return found


def camera_from_vector(model: str, size: tuple[int, int], lens: Array, num_distortion: int) -> Camera:
    """Return the camera of a parameter vector; a pinhole keeps its first `num_distortion` coefficients."""
    fx, fy, cx, cy, *k = (float(value) for value in lens)
    width, height = size
    if model == "fisheye":
        return Fisheye(width, height, fx, fy, cx, cy, (k[0], k[1], k[2], k[3]))
    if model == "omni":
        return Omni(width, height, fx, fy, cx, cy, lens[XI].item(), (k[0], k[1], k[2], k[3]))
    if model == "ocam":
        powers = (value * fx ** (1 - power) for power, value in enumerate((1.0, 0.0, *k[: OCAM_DEGREE - 1])))
        return OCam(width, height, cx, cy, tuple(powers), fy / fx, k[OCAM_DEGREE - 1] * fy / fx, 0.0)
    return Pinhole(width, height, fx, fy, cx, cy, tuple(k[:num_distortion]))


def free_parameters(model: str, num_distortion: int) -> NDArray[np.bool_]:
    """Return which of the 12 parameters a model has."""
    number = np.arange(NUM_LENS)
    if model == "omni":
        return (number <= XI) & (number != K3)
    return number < 4 + (num_distortion if model == "pinhole" else 4)


def focal_lengths(models: tuple[str, ...], lenses: Array) -> Array:
    """Return pixels per radian (C,) on the axes of lenses (C, 12): f alone says nothing where xi is found, too."""
    xi = np.where(np.array(models) == "omni", lenses[:, XI], 0.0)
    found: Array = lenses[:, :2].mean(axis=1) / (1.0 + xi)
    return found


def project_points(model: str, lens: Array, points: Array) -> Array:
    """Return pixels (N, 2) of points (N, 3) in the camera frame; NaN where the model sees none."""
    flat, _ = PROJECTIONS[model](lens, points)
    return flat * lens[:2] + lens[2:4]


def J_lens(model: str, lens: Array, points: Array) -> Array:
    """Return d pixel / d parameters (N, 2, 12)."""
    flat, J_distortion = PROJECTIONS[model](lens, points)
    J = np.zeros((len(points), 2, NUM_LENS))
    J[:, 0, 0], J[:, 1, 1] = flat[:, 0], flat[:, 1]
    J[:, 0, 2] = J[:, 1, 3] = 1.0
    J[:, :, 4:] = J_distortion * lens[:2, None]
    return J


def _pinhole(lens: Array, points: Array) -> tuple[Array, Array]:
    """Return distorted coordinates (N, 2) on the plane z = 1 and their derivative (N, 2, 8) by the coefficients."""
    depth = np.where(points[:, 2] > MIN_DEPTH, points[:, 2], np.nan)
    x, y = points[:, 0] / depth, points[:, 1] / depth
    k1, k2, p1, p2, k3, k4, k5, k6 = lens[4:]
    r2 = x * x + y * y
    numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = numerator / denominator
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    xy = np.stack([x, y], axis=-1)
    J = np.empty((len(points), 2, 8))
    powers = np.stack([r2, r2**2, r2**3], axis=-1)[:, None, :] * (xy / denominator[:, None])[:, :, None]
    J[:, :, [0, 1, 4]] = powers
    J[:, :, 5:] = -radial[:, None, None] * powers
    J[:, 0, 2], J[:, 1, 2] = 2 * x * y, r2 + 2 * y * y
    J[:, 0, 3], J[:, 1, 3] = r2 + 2 * x * x, 2 * x * y
    return np.stack([u, v], axis=-1), J


def _fisheye(lens: Array, points: Array) -> tuple[Array, Array]:
    sine = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(sine, points[:, 2])
    direction = points[:, :2] / np.maximum(sine, 1e-12)[:, None]
    powers = angle[:, None] ** np.array([3, 5, 7, 9])
    radius = angle + powers @ lens[4:8]
    J = np.zeros((len(points), 2, 8))
    J[:, :, :4] = direction[:, :, None] * powers[:, None, :]
    return direction * radius[:, None], J


def _omni(lens: Array, points: Array) -> tuple[Array, Array]:
    """Return those of a pinhole whose centre lies xi behind the unit sphere's; NaN at and beyond its rim."""
    xi, distance = lens[XI], np.linalg.norm(points, axis=1)
    is_seen = (0.0 <= xi <= MAX_XI) & (points[:, 2] > (-xi if xi <= 1.0 else -1.0 / xi) * distance)
    shifted = np.column_stack([points[:, :2], points[:, 2] + xi * distance]) / distance[:, None]
    plane = lens.copy()
    plane[K3:] = 0.0
    flat, J = _pinhole(plane, np.where(is_seen[:, None], shifted, np.nan))
    J[:, :, K3 - 4 :] = 0.0
    x, y = shifted[:, :2].T / shifted[:, 2]
    k1, k2, p1, p2 = lens[4:8]
    r2 = x * x + y * y
    radial, slope = 1 + r2 * (k1 + r2 * k2), 2 * (k1 + 2 * k2 * r2)  # slope: d radial / d r2, twice
    along = np.stack([x * (radial + slope * r2), y * (radial + slope * r2)], axis=1)
    along += 2 * np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=1)
    J[:, :, XI - 4] = -along / shifted[:, 2:]  # x and y shrink together as xi grows
    return flat, J


def _ocam(lens: Array, points: Array) -> tuple[Array, Array]:
    """Return (qx, qy + s qx) and its derivative: the radius r with r cos a = h(r) sin a, a the angle from the axis."""
    sine = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(sine, points[:, 2])
    direction = points[:, :2] / np.maximum(sine, 1e-12)[:, None]
    h = np.array([1.0, 0.0, *lens[4:7]])
    slope, radius = np.arange(1, OCAM_DEGREE + 1) * h[1:], angle.copy()
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            height = np.polyval(h[::-1], radius)
            by_radius = (height - radius * np.polyval(slope[::-1], radius)) / (radius**2 + height**2)
            radius = np.maximum(radius - (np.arctan2(radius, height) - angle) / by_radius, 0.0)
        height = np.polyval(h[::-1], radius)
        radius = np.where(np.abs(np.arctan2(radius, height) - angle) < 1e-9, radius, np.nan)
        by_height = np.sin(angle) / (np.cos(angle) - np.sin(angle) * np.polyval(slope[::-1], radius))
    q = direction * radius[:, None]
    J = np.zeros((len(points), 2, NUM_LENS - 4))
    powers = by_height[:, None] * radius[:, None] ** np.arange(2, OCAM_DEGREE + 1)
    J[:, :, :3] = direction[:, :, None] * powers[:, None, :]
    s = lens[7]
    J[:, 1, :3] += s * J[:, 0, :3]
    J[:, 1, 3] = q[:, 0]
    return np.stack([q[:, 0], q[:, 1] + s * q[:, 0]], axis=-1), J


PROJECTIONS = {"pinhole": _pinhole, "fisheye": _fisheye, "omni": _omni, "ocam": _ocam}
