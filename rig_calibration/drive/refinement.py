"""READ FIRST for cameras refined by a drive: lens and readout time from images in a map, photometrically.

Each image is compared with the map where its pixels should be (M15 eq. 4, 33-35). Lens and readout time are shared by
all images; pose, gain and bias of each image are its own and are eliminated (Schur complement) in every step of
Gauss-Newton, from coarse images to fine ones (`elimination.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig_calibration.drive.drive_image import DriveImage, ImageState, linearize_image
from rig_calibration.drive.drive_lens import FLOOR, Lens
from sphere_nav.estimation.elimination import Elimination
from sphere_nav.geometry.arrays import Array

MAX_STEPS = 12  # at a level
MIN_STEP = 0.02  # of the parameters' standard deviations, below which a level is done
UNOBSERVED = 0.5  # of the deviation known beforehand: more is left than the drive has told


@dataclass(frozen=True, eq=False)
class RefinedCamera:
    """What a drive tells of a camera: values and covariance (P, P) in the order of `lens.names`."""

    lens: Lens
    covariance: Array
    images: tuple[ImageState, ...]
    num_pixels: int
    residual: float  # robust standard deviation in grey levels

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.lens.names, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Parameters that the drive does not tell: their deviation is about what it was before."""
        known = dict(zip(self.lens.names, self.lens.prior_sigma.tolist(), strict=True))
        return tuple(name for name, sigma in self.deviations.items() if sigma > UNOBSERVED * known[name])


def refine_camera(images: Sequence[DriveImage], lens: Lens) -> RefinedCamera:
    """Estimate lens and readout from images with their places in a map; `lens` is where to start.

    Raises ValueError with fewer images than three: their scatter is the covariance.
    """
    if len(images) < 3:
        raise ValueError(f"drive: expected at least three images that are localised, found {len(images)}")
    start, states = lens, [ImageState(image.T_map_camera) for image in images]
    for level in range(len(images[0].levels) - 1, -1, -1):
        for _ in range(MAX_STEPS):
            system = _System(images, states, lens, start, level)
            lens, states, size = system.step()
            if size < MIN_STEP:
                break
    return _System(images, states, lens, start, 0).result()


class _System:
    """The normal equations at a state, those of each image reduced to the shared parameters."""

    def __init__(
        self, images: Sequence[DriveImage], states: Sequence[ImageState], lens: Lens, start: Lens, level: int
    ) -> None:
        self._states, self._lens = states, lens
        self._parts = [linearize_image(image, state, lens, level) for image, state in zip(images, states, strict=True)]
        self._reduced = Elimination(self._parts, lens.prior_sigma, lens.values - start.values)

    def step(self) -> tuple[Lens, list[ImageState], float]:
        """Return the state after a step, and how large the step was."""
        shared, own, size = self._reduced.step()
        states = [state.moved(step) for state, step in zip(self._states, own, strict=True)]
        return self._lens.moved(shared), states, size

    def result(self) -> RefinedCamera:
        """Return the estimate with its covariance."""
        covariance = self._reduced.covariance() + np.diag((FLOOR * self._lens.prior_sigma) ** 2)
        num_pixels = sum(part.num_pixels for part in self._parts)
        residual = float(np.median([part.sigma for part in self._parts]))
        return RefinedCamera(self._lens, covariance, tuple(self._states), num_pixels, residual)
