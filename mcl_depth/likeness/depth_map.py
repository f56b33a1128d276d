"""The map as the filter sees it: depth features at any position, made when first needed (algorithm 2, lines 10 to 16).

Positions fall into square cells whose corners are `cache.max_distance` from the middle, where the depth image is
made. So what a particle sees depends on its own position alone, not on which particle came first.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.depth_cache import DepthCache, keys_of
from mcl_depth.likeness.features import Image, Mask, is_sky
from mcl_depth.likeness.kinds import Visual, likeness_of
from mcl_depth.likeness.level_view import level_view
from mcl_depth.params import FilterParams
from sphere_nav.geometry import Camera, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE, Reason, Verdict

BATCH = 64  # depth images made at once
Heights = Callable[[Array], Array]  # (N, 2) m -> height of the ground (N,) m, NaN where there is none


class DepthMap:
    """Depth features by position, with their cache."""

    def __init__(
        self, synthesizer: DepthSynthesizer, ground: Heights, camera_height: float, params: FilterParams, name: str = ""
    ) -> None:
        """`name` identifies the geometry for the cache on disk; the empty name keeps nothing there."""
        self._synthesizer, self._ground, self._params = synthesizer, ground, params
        self.camera_height = camera_height
        self.edge = params.cache.max_distance * np.sqrt(2.0)
        camera = synthesizer.camera
        self.likeness = likeness_of(params, camera)
        one = self.likeness.depths(np.ones((1, camera.height, camera.width), np.float32))
        self.cache = DepthCache(params.cache.max_megabytes << 20, one)
        self._folder = Path(params.cache.folder) / self._key(name) if params.cache.folder and name else None
        if self._folder is not None:
            self.cache.load(self._folder)

    @property
    def camera(self) -> Spherical:
        """Window of the sphere in which images are compared."""
        return self._synthesizer.camera

    def cells(self, positions: Array) -> NDArray[np.int64]:
        """Return the cells (N, 2) of positions (N, 2)."""
        return np.floor(positions[:, :2] / self.edge).astype(np.int64)

    def heights(self, positions: Array) -> Array:
        """Return the height (N,) m of a camera above the ground at (N, 2); NaN where there is no ground."""
        return self._ground(positions[:, :2]) + self.camera_height

    def height(self, pose: Array) -> float:
        """Return the height m of a camera at x, y of a pose (3,); NaN off the map."""
        return float(self.heights(pose[None, :2])[0])

    def ranges_from(self, pose: Array) -> NDArray[np.float32] | None:
        """Return the range panorama (H, W) in m that a level camera at a pose (3,) has, NaN unknown; None off the map.

        Above all that is known of a column it is far where the sky is.
        """
        height = self.height(pose)
        if not np.isfinite(height):
            return None
        ranges = self._synthesizer.synthesize_many([[*pose[:2], height]])[0]
        if self._params.comparison.is_sky_far:
            ranges[is_sky(ranges)] = np.inf
        return np.roll(ranges, round(float(pose[2]) / (2.0 * np.pi) * self.camera.full_width), axis=1)

    def level(self, image: NDArray[np.generic], camera: Camera, rotation: Array) -> tuple[Image, Mask, Verdict]:
        """Return an image as a level panorama (H, W), what of it is seen, and a finding where that is too little.

        rotation: R_level_camera (3, 3), as of `level_view`.
        """
        gray, is_seen = level_view(image, camera, rotation, self.camera)
        share, least = float(is_seen.mean()), self.likeness.min_seen
        if share >= least:
            return gray, is_seen, FINE
        detail = f"{share:.0%} of the panorama is seen"
        return gray, is_seen, Verdict(Reason.LOW_OVERLAP, share, least, detail)

    def similarities(self, visual: Visual, cells: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the similarity (N, headings) of an image with the depth images of cells; 0 without ground."""
        num_headings = self._params.num_headings
        curves = np.zeros((len(cells), num_headings), dtype=np.float32)
        for first in range(0, len(cells), self.cache.capacity):
            slots = self._slots(cells[first : first + self.cache.capacity])
            known = np.flatnonzero(slots >= 0)
            if len(known):
                found = self.likeness.compare(visual, self.cache.stack, slots[known], num_headings)
                curves[first + known] = np.nan_to_num(found)
        return curves

    def survey(self, visual: Visual, cells: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return how well an image fits many cells (N, headings), no more than the cache holds, in its own units."""
        return self.likeness.survey(visual, self.cache.stack, self._slots(cells), self._params.num_headings)

    def fill(self, positions: Array, at_most: int | None = None) -> int:
        """Make missing depth images of positions (N, 2), as many as the cache holds; return how many are still missing.

        At most so many are made in this call. With a folder they are kept on disk once all are there.
        """
        unique = np.unique(self.cells(positions), axis=0)[: self.cache.capacity]
        on_ground = unique[np.isfinite(self._middles(unique)[:, 2])]
        cells = on_ground[[key not in self.cache for key in keys_of(on_ground)]]
        made = self._slots(cells[:at_most])
        num_missing = len(cells) - len(made)
        if len(made) and not num_missing and self._folder is not None:
            self.cache.save(self._folder)
        return num_missing

    def _middles(self, cells: NDArray[np.int64]) -> Array:
        """Return the camera positions (N, 3) that stand for cells."""
        xy = (cells + 0.5) * self.edge
        return np.column_stack([xy, self.heights(xy)])

    def _slots(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the slots (N,) of cells in the cache, their images made where missing; -1 without ground."""
        slots = self.cache.find(cells)
        missing = np.flatnonzero(slots < 0)
        middles = self._middles(cells[missing])
        is_on_ground = np.isfinite(middles[:, 2])
        missing, middles = missing[is_on_ground], middles[is_on_ground]
        for first in range(0, len(missing), BATCH):
            part = missing[first : first + BATCH]
            features = self.likeness.depths(self._synthesizer.synthesize_many(middles[first : first + BATCH]))
            slots[part] = self.cache.insert(cells[part], features)
        return slots

    def _key(self, name: str) -> str:
        """Return what everything that the features depend on hashes to."""
        p = self._params
        text = f"{name} {p.synthesis} {p.comparison} {self.edge:.9f} {self.camera_height:.9f} {self.camera}"
        text += (
            f"{self.likeness.name} {[(name, part.dtype, part.shape[1:]) for name, part in self.cache.stack.items()]}"
        )
        return hashlib.sha256(text.encode()).hexdigest()[:24]


class Comparison:
    """One visual image against the map; a place is compared once, however many particles are there (S_cache)."""

    def __init__(self, visual: Visual, depth_map: DepthMap) -> None:
        self._visual, self._map = visual, depth_map

    def curves(self, positions: Array) -> NDArray[np.float32]:
        """Return the similarities (N, A) of all headings at positions (N, 2) in m; 0 where the map has no ground."""
        cells, place = np.unique(self._map.cells(positions), axis=0, return_inverse=True)
        return self._map.similarities(self._visual, cells)[place.ravel()]

    def survey(self, positions: Array) -> NDArray[np.float32]:
        """Return how well the image fits at positions (N, 2), one a cell, (N, A), in its own units."""
        return self._map.survey(self._visual, self._map.cells(positions))
