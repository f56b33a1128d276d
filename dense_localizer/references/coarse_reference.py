"""What is kept of every key sphere of a map: enough for choosing among them and for the start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    FORWARD_STEP,
    MIN_COARSE_PIXELS,
    NUM_COARSE_LEVELS,
    NUM_COVERAGE_POINTS,
    NUM_LAID_OUT,
)
from sphere_nav.geometry import Spherical
from sphere_nav.photometric import Reference, RegistrationParams, prepare_reference
from sphere_nav.photometric.constants import CONTRAST_ANGLE
from sphere_nav.photometric.pixels.contrast import local_contrast
from sphere_nav.spheres.appearance.headings import draw_sphere
from sphere_nav.spheres.sphere import Sphere

NUM_PREPARED = 32  # small spheres that are kept ready for alignment: memory, no result


@dataclass(frozen=True, eq=False)
class CoarseReference:
    """A small sphere: its window and its median range in m, infinite without any; the rest is read when needed."""

    camera: Spherical
    typical_range_m: float
    load: Callable[[], Sphere]
    params: RegistrationParams

    @staticmethod
    def load_from(load: Callable[[], Sphere], params: RegistrationParams) -> CoarseReference:
        """Return what is kept of a small sphere."""
        sphere = load()
        finite = sphere.range_m[np.isfinite(sphere.range_m)]
        return CoarseReference(sphere.camera, float(np.median(finite)) if finite.size else np.inf, load, params)

    @property
    def step_m(self) -> float:
        """How far before and behind its middle a camera is looked for, too; 0 without any range."""
        return FORWARD_STEP * self.typical_range_m if np.isfinite(self.typical_range_m) else 0.0

    @cached_property
    def reference(self) -> Reference:
        """Its levels."""
        sphere = self.load()
        return prepare_reference(sphere.levels, sphere.range_m, sphere.camera, limit_levels(self.params))

    @cached_property
    def points(self) -> NDArray[np.float32]:
        """A few points (N, 3) m of the sphere."""
        was_ready, points = "reference" in self.__dict__, self.reference.levels[-1].points
        if not was_ready:
            self.forget()
        return np.ascontiguousarray(points[:, :: max(1, points.shape[1] // NUM_COVERAGE_POINTS)].T)

    def forget(self) -> None:
        """Free what alignment needs; it is made again when needed."""
        self.__dict__.pop("reference", None)


class CoarseReferences(dict[int, CoarseReference]):
    """Small key spheres by id, read when they are first needed; the latest that were prepared, or drawn, stay so."""

    def __init__(self, spheres: Mapping[int, Sphere], params: RegistrationParams) -> None:
        super().__init__()
        self._spheres, self._params = spheres, params
        self._latest: dict[int, None] = {}
        self.panorama = lru_cache(2 * NUM_LAID_OUT)(self._draw)

    def __missing__(self, sphere_id: int) -> CoarseReference:
        self[sphere_id] = CoarseReference.load_from(partial(self._spheres.__getitem__, sphere_id), self._params)
        return self[sphere_id]

    def _draw(self, sphere_id: int, by_contrast: bool = False) -> NDArray[np.float32]:
        """Return the edges of a small sphere, or of its local contrast."""
        sphere = self[sphere_id].load()
        if by_contrast:
            sphere = replace(sphere, image=local_contrast(sphere.levels, sphere.camera, CONTRAST_ANGLE))
        return draw_sphere(sphere)

    def reference(self, sphere_id: int) -> Reference:
        """Return a prepared small sphere."""
        self._latest.pop(sphere_id, None)
        self._latest[sphere_id] = None
        if len(self._latest) > NUM_PREPARED:
            oldest = next(iter(self._latest))
            del self._latest[oldest]
            self[oldest].forget()
        return self[sphere_id].reference


@cache
def limit_levels(params: RegistrationParams) -> RegistrationParams:
    """Return the parameters with as many levels as small spheres have."""
    return replace(params, pyramid=replace(params.pyramid, num_levels=NUM_COARSE_LEVELS, finest=0))


@cache
def stop_at(finest: int, params: RegistrationParams) -> RegistrationParams:
    """Return the parameters of an alignment that stops at the level `finest`."""
    pyramid, least = replace(params.pyramid, finest=max(0, finest)), min(MIN_COARSE_PIXELS, params.min_pixels)
    return replace(params, pyramid=pyramid, max_iterations_fine=params.max_iterations_coarse, min_pixels=least)
