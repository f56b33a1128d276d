"""Compile the kernels of view synthesis on a sphere too small to cost anything."""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, synthesize


def warm_up() -> None:
    """Draw one view; some seconds, or nothing where the cache has the kernels."""
    camera = Spherical(32, 16)
    sphere = Sphere(np.full((16, 32, 3), 9, np.uint8), np.full((16, 32), 5.0, np.float32), camera)
    synthesize([PlacedSurface(surface_of(sphere), SE3.identity())], SE3.identity(), camera)
