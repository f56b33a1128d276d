"""Two versions of a map compared by the key images of drives: how many each places, and where.

Each image is localised for itself, from where it was when it was kept. That a drive is placed no worse means: not fewer
of its images, and of those that both place the median distance from there at most 5 % larger.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dense_localizer.constants import MIN_EXPLAINED_NCC
from dense_localizer.localizer import Localizer
from dense_localizer.motion_prior import measure_position_sigma
from dense_localizer.params import LocalizerParams
from sphere_nav.offline.constants import MAX_OFF, MAX_WORSE, MEDIAN_NOISE, MIN_OFF_M
from sphere_nav.offline.lessons.kept_drives import KeyImage
from sphere_nav.ros.maps.reader import MapReader


@dataclass(frozen=True)
class Placement:
    """Where a map places an image: how far in m from where it was, standard deviation in m, likeness -1...1."""

    off_m: float
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

    def compare(self, after: Marks) -> tuple[float, float, float]:
        """Return medians in m over the images that both place: before, after, and what a change must exceed."""
        pairs = [(a, b) for a, b in zip(self.placements, after.placements, strict=True) if a and b]
        if not pairs:
            return 0.0, 0.0, 0.0
        off = np.array([(a.off_m, b.off_m, a.sigma_m) for a, b in pairs])
        before_m, after_m, sigma_m = np.median(off, axis=0).tolist()
        return before_m, after_m, MEDIAN_NOISE * sigma_m

    def find_worse(self, after: Marks) -> str:
        """Return in words what is worse after than before; nothing where all is as good."""
        if after.num_placed < self.num_placed:
            return f"places {after.num_placed} of {len(self.placements)} key images, before {self.num_placed}"
        before_m, after_m, noise_m = self.compare(after)
        if after_m > MAX_WORSE * before_m + noise_m:
            return f"places key images {1e3 * after_m:.1f} mm off, before {1e3 * before_m:.1f} mm"
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
    return None if is_elsewhere else Placement(off_m, sigma_m, candidate.ncc)
