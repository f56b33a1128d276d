"""What is kept of every key sphere of a map: enough for choosing among them and for the start.

By it an image is compared with the experiences of a map: day or night, summer or winter (MTR's recommendation). Where
nothing is known all experiences within reach are compared with the image, by their edges first: these say more than
grey levels in a light that none of them has. What is in use changes only where it does not explain an image well and
another one does: an image that nothing explains looks like anything.
"""

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
    MIN_COMPARED_POINTS,
    MIN_LIKENESS_LEAD,
    NUM_COARSE_LEVELS,
    NUM_COMPARED_POINTS,
    NUM_KEPT,
    NUM_LAID_OUT,
)
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.photometric import Reference, RegistrationParams, prepare_reference
from sphere_nav.photometric.align.esm import correlate
from sphere_nav.photometric.constants import CONTRAST_ANGLE
from sphere_nav.photometric.pixels.contrast import local_contrast
from sphere_nav.photometric.pixels.pyramid import Level, in_blocks
from sphere_nav.spheres.appearance.headings import cut_view, draw_sphere, score_headings
from sphere_nav.spheres.graph import Experience, KeySphere
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


Tried = tuple[Experience, ...]  # experiences that have not explained an image


class Sight(NamedTuple):
    """The coarsest level of the image, where it is thought to be, and whether it follows one that was placed.

    `instead_of`: experiences that have been tried with this image, and did not do; `wanted`: that which is asked for.
    """

    level: Level
    T_map_camera: SE3
    is_followed: bool = False
    instead_of: Tried = ()
    wanted: Experience | None = None


class ExperienceChoice:
    """The experience in use."""

    def __init__(self, coarse: CoarseReferences) -> None:
        self._coarse = coarse
        self.current: Experience | None = None  # which explained an image last

    def choose(self, within_reach: Mapping[Experience, KeySphere], sight: Sight) -> Experience | None:
        """Return the experience in use while it explains images; `within_reach`: the nearest key sphere of each.

        Else that whose edges are most like the image, of those alike in these by grey levels; of those nearly alike in
        both the first drive's, by whose key spheres later ones were placed. Where some did not do: another one, the one
        in use or that whose edges are most like the image; None where there is no other.
        """
        if sight.instead_of:
            others = {one: node for one, node in within_reach.items() if one not in sight.instead_of}
            if self.current in others:
                return self.current
            return max(others, key=lambda one: self.compare_edges(others[one], sight), default=None)
        known = sight.wanted if sight.wanted in within_reach else self.current if sight.is_followed else None
        if known is not None and known in within_reach:
            return known
        if len(within_reach) == 1:
            return next(iter(within_reach))
        edges = {one: self.compare_edges(node, sight) for one, node in within_reach.items()}
        sharp = [one for one in edges if edges[one] >= max(edges.values()) - MIN_LIKENESS_LEAD]
        grays = {one: self.compare(within_reach[one], sight) for one in sharp}
        needed = max(grays.values()) - MIN_LIKENESS_LEAD
        return min((one for one in sharp if grays[one] >= needed), key=lambda one: within_reach[one].id)

    def compare_edges(self, node: KeySphere, sight: Sight) -> float:
        """Return how alike edges of the image and of a key sphere are from there, whatever the light, -1...1."""
        T_sphere_camera = node.T_map_sphere.inverse() @ sight.T_map_camera
        view = cut_view(sight.level.unpadded, sight.level.camera, T_sphere_camera)
        return float(score_headings(view, self._coarse.panorama(node.id))[0])

    def compare(self, node: KeySphere, sight: Sight) -> float:
        """Return the correlation of the image with a key sphere as it would look from there; -1: too little in view."""
        pixels = self._coarse.reference(node.id).levels[-1].pixels
        blocks = in_blocks(pixels[:, :: max(1, pixels.shape[1] // NUM_COMPARED_POINTS)])
        ncc, count = correlate(blocks, sight.T_map_camera.inverse() @ node.T_map_sphere, sight.level)
        return ncc if count >= MIN_COMPARED_POINTS else -1.0
