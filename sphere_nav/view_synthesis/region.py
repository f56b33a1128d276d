"""How far from a key sphere one can be localised by it, computed from what it saw (M15 section 6.3.3: 3.5 m there).

From a displaced place the surface of the sphere is drawn; a direction counts as usable where the surface is seen there
at a like resolution: no finer or coarser than by a factor, along no axis. What hides behind other things, what the
sphere saw at a grazing angle and what is far nearer or farther than it was does not count. The region ends where too
little of what is usable at the sphere itself is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
    """Return the radius in m of the region around a sphere, the median over horizontal directions; 0 without range."""
    reaches = _start(sphere)
    while wanted := [one for one in reaches if not one.is_found and _may_be_median(one, reaches)]:
        for reach in wanted:
            reach.narrow()
    return float(np.median([reach.middle for reach in reaches])) if reaches else 0.0


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


@dataclass
class _Reach:
    """How far one can go in a direction (3,) while enough is usable: from low to high m, or more while it is open."""

    surface: Surface
    direction: Array
    needed: float
    high: float
    low: float = 0.0
    doublings: int = MAX_DOUBLINGS  # that are left; 0: not open
    bisections: int = NUM_BISECTIONS

    @property
    def is_found(self) -> bool:
        return not self.doublings and not self.bisections

    @property
    def middle(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def end(self) -> float:
        return np.inf if self.doublings else self.high

    def narrow(self) -> None:
        """Try one place."""
        tried = self.high if self.doublings else self.middle
        is_enough = usable_share(self.surface, tried * self.direction) >= self.needed
        if self.doublings:
            self.doublings = self.doublings - 1 if is_enough else 0
            self.low, self.high = (tried, 2 * tried) if is_enough else (self.low, self.high)
        else:
            self.bisections -= 1
            self.low, self.high = (tried, self.high) if is_enough else (self.low, tried)


def _start(sphere: Sphere) -> list[_Reach]:
    """Return the reach in every direction, of which nothing is known yet."""
    small = coarse_sphere(sphere)
    finite = small.range_m[np.isfinite(small.range_m)]
    if not finite.size:
        return []
    surface, step_m = surface_of(small), float(np.median(finite))
    needed = MIN_USABLE_SHARE * usable_share(surface, np.zeros(3))
    azimuths = 2 * np.pi * np.arange(NUM_DIRECTIONS) / NUM_DIRECTIONS
    directions = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(NUM_DIRECTIONS)], axis=1)
    return [_Reach(surface, direction, needed, step_m) for direction in directions]


def _may_be_median(reach: _Reach, reaches: Sequence[_Reach]) -> bool:
    """Say whether a reach may be one in the middle, by what is known of all: intervals are alike or do not overlap."""
    below = sum(one.end <= reach.low for one in reaches)
    above = sum(one.low >= reach.end for one in reaches)
    return max(below, above) <= len(reaches) // 2
