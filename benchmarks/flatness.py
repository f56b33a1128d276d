"""How flat the range of flat things is: planes fitted to regions of recorded pairs that were marked in their images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array

Box = tuple[int, int, int, int]  # first column, first row, beyond the last column, beyond the last row

NUM_TRIALS = 400
NUM_STEPS = 5
MIN_SHARE = 0.3  # of a region must be measured, else nothing is said of it

# marked by looking at the upper image (1024 x 512), before any range of theirs was looked at
REGIONS: dict[str, dict[str, tuple[Box, ...]]] = {
    "real_room": {
        "floor": ((335, 410, 440, 460), (500, 405, 580, 455), (600, 405, 690, 450), (90, 452, 250, 474)),
        "walls": ((376, 268, 428, 345), (428, 222, 452, 290), (505, 212, 535, 262), (885, 320, 960, 342)),
    },
    "rendered_mp3d": {
        "floor": ((5, 325, 130, 372), (450, 375, 620, 395)),
        "walls": ((478, 200, 575, 255), (5, 220, 70, 262), (252, 150, 308, 330), (925, 150, 980, 320)),
    },
}


@dataclass(frozen=True, eq=False)
class Region:
    """A region: what share of it is measured, and how far (N,) its points are off their plane, by their distance."""

    what: str
    measured: float
    off: Array

    @property
    def is_enough(self) -> bool:
        """Whether enough of it is measured."""
        return self.measured >= MIN_SHARE


def fit_regions(name: str, range_m: NDArray[np.float32], rays: Array) -> list[Region]:
    """Return the regions of a recording, from range (H, W) along rays (H, W, 3)."""
    found = []
    for kind, boxes in REGIONS[name].items():
        for u0, v0, u1, v1 in boxes:
            part = range_m[v0:v1, u0:u1]
            known = np.isfinite(part)
            points = rays[v0:v1, u0:u1][known] * part[known][:, None]
            off = off_plane(points) if known.mean() >= MIN_SHARE else np.zeros(0)
            found.append(Region(f"{kind} {u0}:{u1}, {v0}:{v1}", float(known.mean()), off))
    return found


def off_plane(points: Array) -> Array:
    """Return how far points (N, 3) are off the plane that fits most of them, by their distance from the origin.

    The plane of least median, out of planes through three points, made better by least squares of what is near.
    """
    rng, distance = np.random.default_rng(1), np.linalg.norm(points, axis=1)
    best, least = np.abs(distance), np.inf
    some = points[rng.permutation(len(points))[:2000]]
    for _ in range(NUM_TRIALS):
        three = some[rng.integers(len(some), size=3)]
        normal = np.cross(three[1] - three[0], three[2] - three[0])
        normal = normal / max(float(np.linalg.norm(normal)), 1e-12)
        median = float(np.median(np.abs((some - three[0]) @ normal) / np.linalg.norm(some, axis=1)))
        if median < least:
            best, least = np.abs((points - three[0]) @ normal) / distance, median
    for _ in range(NUM_STEPS):
        weight = (best <= 3 * 1.4826 * np.median(best)) / distance
        middle = np.average(points, axis=0, weights=weight**2)
        normal = np.linalg.svd((points - middle) * weight[:, None], full_matrices=False)[2][2]
        best = np.abs((points - middle) @ normal) / distance
    return best
