"""The geometry of a map: points, and perhaps surfaces between them; checked."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mcl_depth.constants import FAR_FROM_ORIGIN_M, INDEX_BITS, LARGE_EXTENT_M, MAX_COORDINATE_M, MAX_LONELY, MIN_POINTS

Points = NDArray[np.float32]


@dataclass(frozen=True)
class Geometry:
    """Points (N, 3) float32 in the map frame in metres, where they came from, and what is odd about them.

    `triangles` (T, 3) int32 of their indices where it is surfaces; none where the points stand alone.
    """

    points: Points
    name: str = "cloud"
    warnings: tuple[str, ...] = ()
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # E, N, H in m of the survey at the origin of the map
    map_id: str = ""  # of a map of key spheres
    triangles: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 3), np.int32))

    @property
    def is_mesh(self) -> bool:
        """Whether it is surfaces."""
        return len(self.triangles) > 0

    @property
    def box(self) -> tuple[Points, Points]:
        """Lowest and highest coordinates, (3,) each."""
        return self.points.min(axis=0), self.points.max(axis=0)


def cloud_from_points(points: ArrayLike, name: str = "cloud") -> Geometry:
    """Check points (N, 3) in m: drop what is not finite, refuse what looks like millimetres.

    ValueError where nothing is left, or where coordinates are too large for float32.
    """
    found = np.asarray(points)
    if found.ndim != 2 or found.shape[1] != 3:
        raise ValueError(f"{name}: points: expected shape (N, 3), found {found.shape}")
    finite = np.isfinite(found).all(axis=1)
    num_lost = len(found) - int(finite.sum())
    if num_lost == len(found):
        raise ValueError(f"{name}: points: expected at least one finite point, found {len(found)} points, none finite")
    found = found[finite] if num_lost else found
    warnings = [f"{name}: {num_lost} of {len(finite)} points are not finite and are left out"] if num_lost else []
    low, high = found.min(axis=0), found.max(axis=0)
    if max(-low.min(), high.max()) > farthest_of(float((high - low).max())):
        raise ValueError(
            f"{name}: points: expected coordinates within {FAR_FROM_ORIGIN_M:g} m of the origin, found"
            f" {np.abs([low, high]).max():.6g} (a survey's frame, or not metres?)"
        )
    extent = float((high - low).max())
    if len(found) >= MIN_POINTS and extent > LARGE_EXTENT_M and (share := lonely_share(found - low)) > MAX_LONELY:
        raise ValueError(
            f"{name}: points: expected metres, found an extent of {extent:.0f} m with {share:.0%} of the points farther"
            " than a metre from all others: this looks like millimetres"
        )
    return Geometry(np.ascontiguousarray(found, np.float32), name, tuple(warnings))


def farthest_of(extent: float) -> float:
    """Return the largest coordinate that points of an extent may have, all in m."""
    return min(max(FAR_FROM_ORIGIN_M, 20.0 * extent), MAX_COORDINATE_M)


def lonely_share(points: NDArray[np.floating]) -> float:
    """Return the share of points (N, 3), all positive, that are alone in their cube of a metre."""
    _, counts = np.unique(cube_keys(points, np.zeros(3), 1.0), return_counts=True)
    return float(np.count_nonzero(counts == 1)) / len(points)


def cube_keys(points: NDArray[np.floating], corner: NDArray[np.floating], side: float) -> NDArray[np.int64]:
    """Return a number (N,) for the cube that each point (N, 3) lies in; in the order of x, y, z from a corner (3,) on.

    It is of one cube alone within `2 ** INDEX_BITS` sides of the corner.
    """
    keys = np.zeros(len(points), np.int64)
    for axis, low in zip(points.T, corner, strict=True):  # one after the other: a third of the memory
        keys <<= INDEX_BITS + 1
        keys ^= np.floor((axis - low) / side).astype(np.int64)
    return keys


def means_of(points: NDArray[np.float64], size: float, name: str) -> NDArray[np.float64]:
    """Return the mean point (N, 3) of each voxel; ValueError where points are too wide for such voxels."""
    low = points.min(axis=0)
    if (extent := float((points - low).max())) / size >= 2**INDEX_BITS:
        raise ValueError(f"{name}: expected an extent below {2**INDEX_BITS * size:g} m, found {extent:g} m")
    _, voxel, counts = np.unique(cube_keys(points, low, size), return_inverse=True, return_counts=True)
    return np.stack([np.bincount(voxel, axis) for axis in points.T], axis=1) / counts[:, None]
