"""How far from a key sphere one can be localised by it, computed from what it saw (M15 section 6.3.3: 3.5 m there).

From a displaced place the surface of the sphere is drawn; a direction counts as usable where the surface is seen there
at a like resolution: no finer or coarser than by a factor, along no axis. What hides behind other things, what the
sphere saw at a grazing angle and what is far nearer or farther than it was does not count. The region ends where too
little of what is usable at the sphere itself is left.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.surface import Surface, surface_of
from sphere_nav.view_synthesis.synthesis import draw_surfaces

MAX_RATIO = 2.0  # of resolutions
MIN_SHARE = 0.2  # of what is usable at the sphere: both kinds of error were alike on towns 3, 5, 7 and 11
WINDOW = Spherical(96, 21, 96, 0.0, 13.5)  # of 40 degrees above and below the horizon, where cameras look
SKY = np.float32(1 / 300.0)  # 1/m: what is farther tells no position
NUM_DIRECTIONS = 6
MAX_DOUBLINGS, NUM_BISECTIONS = 4, 3


def region_radius(sphere: Sphere) -> float:
    """Return the radius in m of the region around a sphere, the median over horizontal directions; 0 without range."""
    radii = region_radii(sphere)
    return float(np.median(radii)) if radii.size else 0.0


def region_radii(sphere: Sphere) -> Array:
    """Return how far the region reaches in m towards `NUM_DIRECTIONS` azimuths, the first ahead; empty: no range."""
    small = coarse_sphere(sphere)
    finite = small.range_m[np.isfinite(small.range_m)]
    if not finite.size:
        return np.zeros(0)
    surface = surface_of(small)
    needed = MIN_SHARE * usable_share(surface, np.zeros(3))
    azimuths = 2 * np.pi * np.arange(NUM_DIRECTIONS) / NUM_DIRECTIONS
    directions = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(NUM_DIRECTIONS)], axis=1)
    return np.array([_reach(surface, direction, float(np.median(finite)), needed) for direction in directions])


def usable_share(surface: Surface, shift_m: Array) -> float:
    """Return the share (0..1, by solid angle) of a horizontal band that is usable from a place (3,) beside it."""
    nearness, source = draw_surfaces(surface, SE3.from_parts(np.eye(3), -shift_m), WINDOW)
    is_known = nearness > SKY
    rays = surface.camera.unproject(np.where(is_known[..., None], source, 0.0))
    cosine = _cosines()
    step = 1.0 / WINDOW.pixels_per_radian
    across = (rays[1:-1, 2:] - rays[1:-1, :-2]) / (2 * step * cosine[1:-1, :, None])
    down = (rays[2:, 1:-1] - rays[:-2, 1:-1]) / (2 * step)
    a, b, c = (np.sum(one, axis=-1) for one in (across**2, across * down, down**2))
    mean, spread = 0.5 * (a + c), np.sqrt(np.maximum(0.25 * (a - c) ** 2 + b**2, 0.0))
    is_alike = (mean + spread < MAX_RATIO**2) & (mean - spread > MAX_RATIO**-2)
    weight = np.broadcast_to(cosine[1:-1], is_alike.shape)
    return float(np.sum(weight * (is_alike & is_known[1:-1, 1:-1])) / np.sum(weight))


@cache
def _cosines() -> Array:
    """Return the cosine (rows, 1) of the elevation of the window's rows."""
    return np.cos(np.arcsin(pixel_rays(WINDOW)[:, :1, 2]))


def _reach(surface: Surface, direction: Array, step_m: float, needed: float) -> float:
    """Return how far one can go in a direction (3,) while enough is usable."""
    low, high = 0.0, step_m
    for _ in range(MAX_DOUBLINGS):
        if usable_share(surface, high * direction) < needed:
            break
        low, high = high, 2 * high
    for _ in range(NUM_BISECTIONS):
        middle = 0.5 * (low + high)
        if usable_share(surface, middle * direction) >= needed:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
