"""What is kept of every key sphere of a map: enough for choosing among them and for the start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    FORWARD_STEP,
    MIN_COARSE_PIXELS,
    NUM_COARSE_LEVELS,
    NUM_KEPT,
    NUM_LAID_OUT,
)
from sphere_nav.geometry import Spherical
from sphere_nav.photometric import Reference, RegistrationParams, prepare_reference
from sphere_nav.photometric.constants import CONTRAST_ANGLE
from sphere_nav.photometric.pixels.contrast import local_contrast
from sphere_nav.spheres.appearance.headings import draw_sphere
from sphere_nav.spheres.sphere import Sphere


class CoarseReference(NamedTuple):
    """The window of a small sphere and its median range in m, infinite without any."""

    camera: Spherical
    typical_range_m: float

    @property
    def step_m(self) -> float:
        """How far before and behind its middle a camera is looked for, too; 0 without any range."""
        return FORWARD_STEP * self.typical_range_m if np.isfinite(self.typical_range_m) else 0.0


class CoarseReferences(dict[int, CoarseReference]):
    """Small key spheres by id, read when they are first needed; the latest that were prepared, or drawn, stay so."""

    def __init__(self, spheres: Mapping[int, Sphere], params: RegistrationParams) -> None:
        super().__init__()
        self.load, self._params = spheres.__getitem__, limit_levels(params)
        self.reference = lru_cache(2 * NUM_KEPT)(self._prepare)
        self.panorama = lru_cache(2 * NUM_LAID_OUT)(self._draw)

    def __missing__(self, sphere_id: int) -> CoarseReference:
        sphere = self.load(sphere_id)
        finite = sphere.range_m[np.isfinite(sphere.range_m)]
        self[sphere_id] = CoarseReference(sphere.camera, float(np.median(finite)) if finite.size else np.inf)
        return self[sphere_id]

    def _prepare(self, sphere_id: int) -> Reference:
        """Return the levels of a small sphere."""
        sphere = self.load(sphere_id)
        return prepare_reference(sphere.levels, sphere.range_m, sphere.camera, self._params)

    def _draw(self, sphere_id: int, by_contrast: bool = False) -> NDArray[np.float32]:
        """Return the edges of a small sphere, or of its local contrast."""
        sphere = self.load(sphere_id)
        if by_contrast:
            sphere = replace(sphere, image=local_contrast(sphere.levels, sphere.camera, CONTRAST_ANGLE))
        return draw_sphere(sphere)


@cache
def limit_levels(params: RegistrationParams) -> RegistrationParams:
    """Return the parameters with as many levels as small spheres have."""
    return replace(params, pyramid=replace(params.pyramid, num_levels=NUM_COARSE_LEVELS, finest=0))


@cache
def stop_at(finest: int, params: RegistrationParams) -> RegistrationParams:
    """Return the parameters of an alignment that stops at the level `finest`."""
    pyramid, least = replace(params.pyramid, finest=max(0, finest)), min(MIN_COARSE_PIXELS, params.min_pixels)
    return replace(params, pyramid=pyramid, max_iterations_fine=params.max_iterations_coarse, min_pixels=least)
