"""How far from a key sphere one can be localised by it, computed from what it saw (M15 section 6.3.3: 3.5 m there).

From a displaced place the surface of the sphere is drawn; a direction counts as usable where the surface is seen there
at a like resolution: no finer or coarser than by a factor, along no axis. What hides behind other things, what the
sphere saw at a grazing angle and what is far nearer or farther than it was does not count. The region ends where too
little of what is usable at the sphere itself is left.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.constants import (
    MAX_DOUBLINGS,
    MAX_RESOLUTION_RATIO,
    MIN_USABLE_SHARE,
    NUM_BISECTIONS,
    NUM_DIRECTIONS,
    SKY,
    WINDOW,
)
from sphere_nav.view_synthesis.surface import Surface, surface_of
from sphere_nav.view_synthesis.synthesis import draw_surfaces


def region_radius(sphere: Sphere) -> float:
    """Return the radius in m of the region around a sphere: up to where most directions are usable; 0 without range."""
    small = coarse_sphere(sphere)
    finite = small.range_m[np.isfinite(small.range_m)]
    if not finite.size:
        return 0.0
    surface, low, high = surface_of(small), 0.0, float(np.median(finite))
    needed = MIN_USABLE_SHARE * usable_share(surface, np.zeros(3))
    for _ in range(MAX_DOUBLINGS):
        if not _is_usable(surface, high, needed):
            break
        low, high = high, 2.0 * high
    for _ in range(NUM_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _is_usable(surface, middle, needed) else (low, middle)
    return 0.5 * (low + high)


def _is_usable(surface: Surface, distance_m: float, needed: float) -> bool:
    """Say whether in most horizontal directions enough is usable so far away."""
    azimuths = 2 * np.pi * np.arange(NUM_DIRECTIONS) / NUM_DIRECTIONS
    shifts_m = distance_m * np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(NUM_DIRECTIONS)])
    return sum(usable_share(surface, shift_m) >= needed for shift_m in shifts_m) > NUM_DIRECTIONS // 2


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
    is_alike = (mean + spread < MAX_RESOLUTION_RATIO**2) & (mean - spread > MAX_RESOLUTION_RATIO**-2)
    weight = np.broadcast_to(cosine[1:-1], is_alike.shape)
    return float(np.sum(weight * (is_alike & is_known[1:-1, 1:-1])) / np.sum(weight))


@cache
def _cosines() -> Array:
    """Return the cosine (rows, 1) of the elevation of the window's rows."""
    return np.cos(np.arcsin(pixel_rays(WINDOW)[:, :1, 2]))
