"""READ FIRST for cameras refined by a drive: lens and readout time from images in a map, photometrically.

Each image is compared with the map where its pixels should be (M15 eq. 4, 33-35). Lens and readout time are shared by
all images; pose, gain and bias of each image are its own and are eliminated (Schur complement) in every step of
Gauss-Newton, from coarse images to fine ones (`elimination.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from rig_calibration.constants import HELD, LENS_FLOOR, LENS_STEPS, MIN_LENS_STEP, UNOBSERVED
from rig_calibration.drive.drive_image import DriveImage, ImageState, differentiate, weigh_part
from rig_calibration.drive.drive_lens import Lens
from sphere_nav.estimation.elimination import Elimination
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class RefinedCamera:
    """The lens, standard deviations (P,) of its parameters before, and their covariance (P, P) now."""

    prior_sigma: Array
    covariance: Array
    states: tuple[ImageState, ...]
    num_pixels: int
    residual: float  # robust standard deviation in grey levels
    lens: Lens

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.lens.names, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Parameters that the drive does not tell: their deviation is about what it was before."""
        return tuple(compress(self.lens.names, np.sqrt(np.diagonal(self.covariance)) > UNOBSERVED * self.prior_sigma))


def refine_camera(
    images: Sequence[DriveImage],
    lens: Lens,
    start: tuple[Lens, Sequence[ImageState]] | None = None,
    held: Collection[str] = (),
    num_blocks: int = 0,
    progress: Callable[[], object] = lambda: None,
) -> RefinedCamera:
    """Estimate lens and readout from images with their places in a map; `lens` is what was known beforehand.

    `start` is where to start at full size, if it is near; `held` names what stays as it was known; neighbours in
    `num_blocks` runs of images may err alike; each step calls `progress`.

    Raises ValueError with fewer images than three: their scatter is the
    covariance.
    """
    if len(images) < 3:
        raise ValueError(f"drive: expected at least three images that are localised, found {len(images)}")

    def linearize(found: Lens, states: Sequence[ImageState], level: int) -> Elimination:
        progress()
        pairs = zip(images, states, strict=True)
        parts = [weigh_part(*differentiate(image, state, found, level)) for image, state in pairs]
        return Elimination(parts, prior_sigma, found.values - lens.values)

    prior_sigma = lens.prior_sigma * np.where([name in held for name in lens.names], HELD, 1.0)
    found, states = lens, [ImageState(image.T_map_camera) for image in images]
    levels = range(len(images[0].levels) - 1, -1, -1)
    if start is not None:
        found, states, levels = start[0], list(start[1]), range(1)
    for level in levels:
        for _ in range(LENS_STEPS):
            step, own, size = linearize(found, states, level).step()
            found = found.moved(step)
            states = [state.moved(one) for state, one in zip(states, own, strict=True)]
            if size < MIN_LENS_STEP:
                break
    last = linearize(found, states, 0)
    covariance = last.covariance(num_blocks) + np.diag((LENS_FLOOR * prior_sigma) ** 2)
    told = last.num_pixels, last.sigma
    return RefinedCamera(lens.prior_sigma, covariance, tuple(states), *told, found)
