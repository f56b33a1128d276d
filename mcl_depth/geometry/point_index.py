"""Range panoramas of a point cloud: points in an octree of ever coarser copies, drawn as splats, the closest wins.

A tile of the octree is drawn from the copy whose spacing is just below the width of a pixel at the tile's distance,
so that the work depends on the picture, not on the size of the map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import COARSENESS, ELEVATIONS_DEG, INDEX_BITS, MAX_ELEVATION_DEG, NEAREST_M, SPLAT
from mcl_depth.geometry import kernels
from mcl_depth.geometry.cloud import Cloud
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry import Spherical

Image = NDArray[np.float32]

TILE_BITS = 4  # a tile is 2^4 voxels wide
MAX_ROOTS = 8  # copies are made until so few tiles hold everything


class PointIndex:
    """A cloud in levels; level l has voxels of voxel_m 2^l."""

    def __init__(self, cloud: Cloud, camera: Spherical, params: SynthesisParams) -> None:
        if len(cloud) == 0:
            raise ValueError(f"{cloud.name}: points: expected at least one, found none")
        self._camera, self._params = camera, params
        self._build(cloud)

    @property
    def num_points(self) -> int:
        """Points of the finest level."""
        return int(self._num_finest)

    def ranges(self, positions_map: NDArray[np.float64]) -> Image:
        """Return ranges (M, H, W) in m around places (M, 3); NaN where no point is drawn."""
        camera, params = self._camera, self._params
        window = np.array([camera.full_width, camera.offset_v], np.float32)
        lowest, highest = ELEVATIONS_DEG
        limits = np.tan(np.radians(np.clip([lowest, highest], -MAX_ELEVATION_DEG, MAX_ELEVATION_DEG)))
        return kernels.draw_many(
            positions_map, self._points, self._tiles, self._boxes, self._voxels, self._num_roots,
            window, limits, COARSENESS, SPLAT, NEAREST_M, params.max_range_m,
            np.empty((len(positions_map), camera.height, camera.width), np.float32),
        )  # fmt: skip

    def _build(self, cloud: Cloud) -> None:
        voxel = self._params.voxel_m
        points, counts, codes = _finest(cloud, voxel)
        self._num_finest = len(points)
        levels = []
        while True:
            levels.append(_tiles_of(points, codes))
            if len(levels[-1][3]) <= MAX_ROOTS or len(levels) > INDEX_BITS - TILE_BITS:
                break
            points, counts, codes = _merge(points, counts, codes >> 3)
        levels.reverse()  # coarse first: the roots lead
        self._num_roots = len(levels[0][3])
        self._points = np.concatenate([level[0] for level in levels]).astype(np.float32)
        self._boxes = np.concatenate([level[2] for level in levels]).astype(np.float32)
        self._voxels = np.concatenate(
            [np.full(len(level[3]), voxel * 2.0 ** (len(levels) - 1 - i)) for i, level in enumerate(levels)]
        ).astype(np.float32)
        self._tiles = _link([level[1] for level in levels], [level[3] for level in levels])


def _finest(cloud: Cloud, voxel: float) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return mean points, how many each stands for, and Morton codes of their voxels, in order of the codes."""
    points = cloud.points.astype(np.float64)
    low, high = cloud.box
    if float((high - low).max()) / voxel >= 2**INDEX_BITS:
        raise ValueError(
            f"{cloud.name}: expected an extent below {2**INDEX_BITS * voxel:g} m, found {(high - low).max():g} m"
        )
    index = np.floor((points - low) / voxel).astype(np.int64)
    codes = _spread(index[:, 0]) | _spread(index[:, 1]) << 1 | _spread(index[:, 2]) << 2
    order = np.argsort(codes, kind="stable")
    return _merge(points[order], np.ones(len(points), np.int64), codes[order])


def _merge(
    points: NDArray[np.float64], counts: NDArray[np.int64], codes: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Join the points of equal, sorted codes to their mean."""
    first = np.flatnonzero(np.append(True, codes[1:] != codes[:-1]))
    total = np.add.reduceat(counts, first)
    means = np.add.reduceat(points * counts[:, None], first) / total[:, None]
    return means, total, codes[first]


def _tiles_of(
    points: NDArray[np.float64], codes: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Return the points, the first point of each tile (T,), boxes (T, 6) and codes (T,)."""
    owner = codes >> (3 * TILE_BITS)
    first = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
    boxes = np.hstack([np.minimum.reduceat(points, first), np.maximum.reduceat(points, first)])
    return points, np.append(first, len(points)), boxes, owner[first]


def _link(firsts: list[NDArray[np.int64]], codes: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return (first point, end point, first child, end child) of every tile (T, 4); levels coarse first."""
    tiles = []
    point_base = 0
    child_base = 0
    for i, first in enumerate(firsts):
        child_base += len(codes[i])
        children = np.zeros((len(codes[i]), 2), np.int64)
        if i + 1 < len(codes):
            parents = codes[i + 1] >> 3
            children[:, 0] = child_base + np.searchsorted(parents, codes[i], "left")
            children[:, 1] = child_base + np.searchsorted(parents, codes[i], "right")
        tiles.append(np.hstack([np.stack([first[:-1], first[1:]], axis=1) + point_base, children]))
        point_base += int(first[-1])
    return np.ascontiguousarray(np.concatenate(tiles))


def _spread(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return numbers of 20 bits with two zeros between their bits."""
    x = index.astype(np.int64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | x << shift) & mask
    return x
