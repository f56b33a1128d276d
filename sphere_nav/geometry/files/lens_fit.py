"""A lens of another program's model as one of ours that comes nearest to it, and how near that is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere
from sphere_nav.geometry.cameras.fisheye import Fisheye

MAX_CALLS = 1000  # of the projection in one fit
STARTS = (-0.4, -0.2, 0.0, 0.3)  # of xi
MAX_RMS_PX, MAX_PX = 0.3, 1.0  # beyond which a lens of ours is no stand-in
GRID = 40  # pixels that are compared, across and down


@dataclass(frozen=True)
class LensFit:
    """The camera of ours, and by how much its pixels are elsewhere: RMS and largest, px."""

    camera: Camera
    rms_px: float
    max_px: float


def grid_of(size: tuple[int, int]) -> Array:
    """Return pixels (GRID * GRID, 2) all over an image of a size (width, height)."""
    u, v = (np.linspace(0.0, side - 1.0, GRID) for side in size)
    return np.stack([plane.ravel() for plane in np.meshgrid(u, v)], axis=1)


def fit_lens(rays: Array, pixels: Array, size: tuple[int, int], focal_px: float, where: str) -> LensFit:
    """Return the double sphere or fisheye that projects rays (N, 3) nearest to pixels (N, 2).

    ValueError, with the residual, where neither comes within MAX_RMS_PX and MAX_PX.
    """
    center = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    fisheye = np.array([focal_px, focal_px, *center, 0.0, 0.0, 0.0, 0.0])
    found = [_fit(lambda x: Fisheye(*size, x[0], x[1], x[2], x[3], (x[4], x[5], x[6], x[7])), fisheye, rays, pixels)]
    for xi in STARTS:  # of a double sphere, whose residual has several minima
        sphere = np.array([focal_px * (1.0 + xi), focal_px * (1.0 + xi), *center, xi, 0.5])
        found.append(_fit(lambda x: DoubleSphere(*size, *x), sphere, rays, pixels))
    best = min(found, key=lambda fit: fit.rms_px)
    if not (best.rms_px < MAX_RMS_PX and best.max_px < MAX_PX):
        raise ValueError(
            f"{where}: expected a lens that double_sphere or fisheye stands in for within {MAX_RMS_PX} px RMS and "
            f"{MAX_PX} px, found {best.rms_px:.2g} and {best.max_px:.2g} px"
        )
    return best


def _fit(make: Callable[[Sequence[float]], Camera], start: Array, rays: Array, pixels: Array) -> LensFit:
    """Return the camera nearest to the pixels, by Levenberg-Marquardt from a start."""
    scale = np.where(np.abs(start) > 1.0, np.abs(start), 1.0)
    found = least_squares(
        lambda values: _errors(make, values, rays, pixels), start, method="lm", x_scale=scale, max_nfev=MAX_CALLS
    )
    values, errors = found.x, found.fun
    apart = np.linalg.norm(errors.reshape(-1, 2), axis=1)
    return LensFit(make(values.tolist()), float(np.sqrt(np.mean(np.square(apart)))), float(apart.max()))


def _errors(make: Callable[[Sequence[float]], Camera], values: Array, rays: Array, pixels: Array) -> Array:
    """Return how far pixels (N, 2) are off, flat; far off where the camera sees nothing or is none."""
    try:
        projected = make(values.tolist()).project(rays)[0]
    except ValueError:
        return np.full(pixels.size, 1e4)
    return np.nan_to_num(projected - pixels, nan=1e4, posinf=1e4, neginf=-1e4).ravel()
