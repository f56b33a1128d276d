"""Two versions of a map compared by the key images of drives: how many each places, and where.

Each image is localised for itself, from where it was when it was kept. That was told by the map of that day, so the
map that told it is always nearest to it: by how much says nothing. That a drive is placed no worse means three things.
Not fewer of its images are placed. Those that both maps place lie no farther from where they were than both
uncertainties allow: where covariances are honest and errors independent, the sum of the squared Mahalanobis distances
is chi-squared, and a map as good as the old one is refused once in a thousand times. And their places are as certain as
before: the median standard deviation grows by 5 % at most, without which a map could pass by knowing less.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from dense_localizer.constants import MIN_EXPLAINED_NCC
from dense_localizer.localizer import Localizer
from dense_localizer.motion_prior import measure_position_sigma
from dense_localizer.params import LocalizerParams
from sphere_nav.estimation.gates import squared_distance
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav_tools.offline.constants import FALSE_REFUSAL, MAX_OFF, MAX_WORSE, MIN_OFF_M
from sphere_nav_tools.offline.lessons.kept_drives import KeyImage


@dataclass(frozen=True)
class Placement:
    """Where a map places an image: from where it was, m and squared by both covariances; deviation, m; likeness."""

    off_m: float
    squared: float  # Mahalanobis distance of the two poses; chi-squared of 6 where both are what they say
    sigma_m: float
    ncc: float


@dataclass(frozen=True)
class Marks:
    """What a map makes of the images of a drive; None for one that it does not place."""

    placements: tuple[Placement | None, ...]

    @property
    def num_placed(self) -> int:
        """Images that are placed."""
        return sum(one is not None for one in self.placements)

    @property
    def num_explained(self) -> int:
        """Images that are placed and look like the map."""
        return sum(one is not None and one.ncc >= MIN_EXPLAINED_NCC for one in self.placements)

    def find_worse(self, after: Marks) -> str:
        """Return in words what is worse after than before; nothing where all is as good."""
        if after.num_placed < self.num_placed:
            return f"places {after.num_placed} of {len(self.placements)} key images, before {self.num_placed}"
        pairs = [(a, b) for a, b in zip(self.placements, after.placements, strict=True) if a and b]
        if not pairs:
            return ""
        told = np.array([[(one.off_m, one.squared, one.sigma_m) for one in pair] for pair in pairs])
        old_sum, new_sum = told[..., 1].sum(axis=0)
        if new_sum > max(old_sum, chi2.isf(FALSE_REFUSAL, 6 * len(pairs))):
            old_mm, new_mm = 1e3 * np.median(told[..., 0], axis=0)
            return f"places key images {new_mm:.1f} mm off, before {old_mm:.1f} mm, more than both are uncertain"
        old_mm, new_mm = 1e3 * np.median(told[..., 2], axis=0)
        if new_mm > MAX_WORSE * old_mm:
            return f"places key images with a standard deviation of {new_mm:.1f} mm, before {old_mm:.1f} mm"
        return ""


def localize_key_images(reader: MapReader, images: Iterable[KeyImage], params: LocalizerParams) -> Marks:
    """Localise key images in a map, each for itself; `params` as on the vehicle, but for a search of the whole map."""
    localizer = Localizer(params, reader)
    try:
        return Marks(tuple(_place(localizer, one) for one in images))
    finally:
        localizer.references.close()


def _place(localizer: Localizer, one: KeyImage) -> Placement | None:
    """Return where an image is placed, searched around where it was; None where it is not, or is elsewhere."""
    localizer.reset()
    try:
        localizer.relocalize(one.T_map_camera)
    except ValueError:  # no key sphere near
        return None
    candidate = localizer.update(one.image, one.camera, one.stamp_ns).candidate
    if candidate is None or not candidate.is_accepted:
        return None
    off_m = float(candidate.T_map_camera.distance(one.T_map_camera)[0])
    sigma_m = measure_position_sigma(candidate.covariance)
    is_elsewhere = off_m > max(MAX_OFF * (sigma_m + measure_position_sigma(one.covariance)), MIN_OFF_M)
    if is_elsewhere:
        return None
    squared = squared_distance(one.T_map_camera, candidate.T_map_camera, one.covariance + candidate.covariance)
    return Placement(off_m, squared, sigma_m, candidate.ncc)
