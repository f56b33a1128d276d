"""A cloud in columns of voxels, in ever coarser levels: every voxel with its mean, its height and its plane.

The finest level is fitted to the cloud: planes through the neighbourhoods, and voxels of a plane that no point fell
into are filled. Each further level joins 2 x 2 x 2 voxels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import (
    INDEX_BITS,
    MAX_BLOCKS,
    MIN_NORMAL_SHARE,
    NUM_CLOSINGS,
    PLANE_NOISE,
    PLANE_TOLERANCE,
    SPLAT,
)
from mcl_depth.geometry.cloud import Cloud
from mcl_depth.geometry.columns import kernels

Floats = NDArray[np.float64]
Cells = NDArray[np.int32]


@dataclass(frozen=True)
class Grid:
    """Which voxels stand in which column: blocks (X, Y) i4, starts (B * CELLS + 1,) i4; see kernels._column."""

    blocks: NDArray[np.int32]
    starts: NDArray[np.int32]

    def tops(self, voxels: Floats) -> NDArray[np.float32]:
        """Return the highest z of every column, NaN where it is empty; as long as starts."""
        found = np.full(len(self.starts), np.nan, np.float32)
        has_any = np.flatnonzero(np.diff(self.starts))
        found[has_any] = np.maximum.reduceat(voxels[:, 4], self.starts[has_any])
        return found


@dataclass(frozen=True)
class VoxelLevel:
    """Voxels by block, column and height: cells (V, 3), voxels (V, 8) as in kernels.py, counts (V,)."""

    size: float
    cells: Cells
    voxels: Floats
    counts: NDArray[np.int64]
    grid: Grid


@dataclass(frozen=True)
class VoxelMap:
    """Levels, fine to coarse, in coordinates from `corner` (3,) m; extent (3,) m."""

    levels: list[VoxelLevel]
    corner: Floats
    extent: Floats
    dense_share: float  # of the voxels whose neighbourhood is a surface


def voxel_map(cloud: Cloud, size: float, num_levels: int) -> VoxelMap:
    """Return the columns of a cloud; ValueError where it is too wide for voxels of `size` m."""
    corner, high = (bound.astype(np.float64) for bound in cloud.box)
    extent = high - corner
    if float(extent.max()) / size >= 2**INDEX_BITS:
        limit = 2**INDEX_BITS * size
        raise ValueError(f"{cloud.name}: expected an extent below {limit:g} m, found {extent.max():g} m")
    if (num_blocks := float(np.prod(np.ceil(extent[:2] / (size * 2**kernels.BLOCK_BITS))))) > MAX_BLOCKS:
        found = f"{extent[0]:.0f} x {extent[1]:.0f} m ({num_blocks:.0f})"
        raise ValueError(f"{cloud.name}: expected at most {MAX_BLOCKS} blocks of columns of {size:g} m, found {found}")
    level, dense_share = _finest(cloud.points.astype(np.float64) - corner, size)
    levels = [level]
    while len(levels) < num_levels:
        levels.append(_coarser(levels[-1]))
    return VoxelMap(levels, corner, extent, dense_share)


def _finest(points: Floats, size: float) -> tuple[VoxelLevel, float]:
    """Return the level of the cloud itself, and the share of its voxels that are a surface."""
    cells, order, first = _sort(np.floor(points / size).astype(np.int32))
    counts = np.diff(np.append(first, len(points)))
    means = np.add.reduceat(points[order], first) / counts[:, None]
    grid = _grid(cells)
    normals, is_dense = kernels.fit_planes(means, cells, grid.blocks, grid.starts, size)
    for _ in range(NUM_CLOSINGS):
        cells, means, normals = _close_gaps(cells, means, normals, _grid(cells), size)
    voxels = np.hstack([means, _heights(means, normals, size), normals])
    return VoxelLevel(size, cells, voxels, np.ones(len(cells), np.int64), _grid(cells)), float(is_dense.mean())


def _close_gaps(cells: Cells, means: Floats, normals: Floats, grid: Grid, size: float) -> tuple[Cells, Floats, Floats]:
    """Return cells, means and normals with the gaps in planes filled from both sides."""
    far = kernels.find_gaps(means, normals, cells, grid.blocks, grid.starts, size, PLANE_TOLERANCE)
    near, direction = np.nonzero(far >= 0)
    other = far[near, direction]
    new_cells = cells[near] + kernels.DIRECTIONS[direction].astype(np.int32)
    inside = np.all(new_cells >= 0, axis=1)
    cells = np.concatenate([cells, new_cells[inside]])
    means = np.concatenate([means, 0.5 * (means[near] + means[other])[inside]])
    normals = np.concatenate([normals, normals[near][inside]])
    cells, order, first = _sort(cells)  # stable: what was there stays
    return cells, means[order][first], normals[order][first]


def _heights(means: Floats, normals: Floats, size: float) -> Floats:
    """Return lowest and highest z (V, 2) of the piece of the plane that a voxel stands for."""
    flat = np.abs(normals[:, :2]).sum(axis=1)
    upright = np.abs(normals[:, 2])
    half = np.full(len(means), 0.5 * SPLAT * size)
    is_plane = flat + upright > 0.0
    half[is_plane] = np.minimum(half[is_plane], 0.5 * size * (flat / np.maximum(upright, 1e-9))[is_plane])
    half = np.maximum(half, PLANE_NOISE * size)
    return np.column_stack([means[:, 2] - half, means[:, 2] + half])


def _coarser(fine: VoxelLevel) -> VoxelLevel:
    """Return the level of twice the size."""
    cells, order, first = _sort(fine.cells >> 1)
    voxels, weights = fine.voxels[order], fine.counts[order]
    counts = np.add.reduceat(weights, first)
    means = np.add.reduceat(voxels[:, :3] * weights[:, None], first) / counts[:, None]
    low, high = np.minimum.reduceat(voxels[:, 3], first), np.maximum.reduceat(voxels[:, 4], first)
    nx, ny, nz = voxels[:, 5:].T
    moments = np.stack([nx * nx, nx * ny, nx * nz, ny * ny, ny * nz, nz * nz], axis=1) * weights[:, None]
    normals = kernels.join_planes(np.add.reduceat(moments, first), MIN_NORMAL_SHARE)
    joined = np.hstack([means, low[:, None], high[:, None], normals])
    return VoxelLevel(2.0 * fine.size, cells, joined, counts, _grid(cells))


def _sort(cells: Cells) -> tuple[Cells, NDArray[np.int64], NDArray[np.int64]]:
    """Return the different cells by block, column and height, the order of all, and the first of each among it."""
    keys = (_column_keys(cells) << INDEX_BITS) | cells[:, 2]
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    first = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    return np.ascontiguousarray(cells[order[first]]), order, first


def _column_keys(cells: Cells) -> NDArray[np.int64]:
    bits = kernels.BLOCK_BITS
    i, j = cells[:, 0].astype(np.int64), cells[:, 1].astype(np.int64)
    blocks = ((i >> bits) << INDEX_BITS) | (j >> bits)
    return blocks << 2 * bits | (i & 12) << 4 | (j & 12) << 2 | (i & 3) << 2 | (j & 3)  # kernels._place


def _grid(cells: Cells) -> Grid:
    """Return which of the sorted voxels stand in which column."""
    keys = _column_keys(cells)
    block_keys = keys >> 2 * kernels.BLOCK_BITS
    used, number = np.unique(block_keys, return_inverse=True)
    shape = (cells[:, :2].max(axis=0) >> kernels.BLOCK_BITS) + 1
    blocks = np.full(tuple(shape), -1, np.int32)
    blocks[used >> INDEX_BITS, used & ((1 << INDEX_BITS) - 1)] = np.arange(len(used))
    columns = number * kernels.CELLS + (keys & (kernels.CELLS - 1))
    starts = np.searchsorted(columns, np.arange(len(used) * kernels.CELLS + 1)).astype(np.int32)
    return Grid(blocks, starts)
