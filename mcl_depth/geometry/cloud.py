"""A point cloud as a map: checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mcl_depth.constants import FAR_FROM_ORIGIN_M, LARGE_EXTENT_M, MAX_COORDINATE_M, MAX_LONELY, MIN_POINTS
from mcl_depth.geometry.survey_frame import lonely_share

Points = NDArray[np.float32]


@dataclass(frozen=True)
class Cloud:
    """Points (N, 3) float32 in the map frame in metres, where they came from, and what is odd about them."""

    points: Points
    name: str = "cloud"
    warnings: tuple[str, ...] = ()
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # E, N, H in m of the survey at the origin of the map

    def __len__(self) -> int:
        return len(self.points)

    @property
    def box(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Lowest and highest coordinates, (3,) each."""
        return self.points.min(axis=0), self.points.max(axis=0)


def cloud_from_points(points: ArrayLike, name: str = "cloud") -> Cloud:
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
    if max(-low.min(), high.max()) > min(max(FAR_FROM_ORIGIN_M, 20.0 * float((high - low).max())), MAX_COORDINATE_M):
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
    return Cloud(np.ascontiguousarray(found, np.float32), name, tuple(warnings))
