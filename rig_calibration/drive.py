"""READ FIRST for cameras refined by a drive: lens and readout time from images in a map, photometrically.

Each image is compared with the map where its pixels should be (M15 eq. 4, 33-35). Lens and readout time are shared by
all images; pose, gain and bias of each image are its own and are eliminated (Schur complement) in every step of
Gauss-Newton, from coarse images to fine ones. The covariance is that of a fit to clustered data: it comes from how
differently the images pull, so that pixels of one image may err together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig_calibration.drive_image import OWN, DriveImage, ImageState, linearize
from rig_calibration.drive_lens import FLOOR, Lens

Array = NDArray[np.float64]

MAX_STEPS = 12  # at a level
MIN_STEP = 0.02  # of the parameters' standard deviations, below which a level is done
CORRELATED_PIXELS = 100.0  # that count as one against what is known beforehand; as in `photometric/correlation.py`
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
        self._parts = [linearize(image, state, lens, level) for image, state in zip(images, states, strict=True)]
        # elimination of what each image has of its own
        self._inverse = [np.linalg.inv(part.H[-OWN:, -OWN:] + 1e-9 * np.eye(OWN)) for part in self._parts]
        n = len(lens.names)
        self._gradients = np.empty((len(images), n))
        self._H = np.zeros((n, n))
        for i, (part, inverse) in enumerate(zip(self._parts, self._inverse, strict=True)):
            cross = part.H[:n, -OWN:] @ inverse
            self._H += part.H[:n, :n] - cross @ part.H[-OWN:, :n]
            self._gradients[i] = part.g[:n] - cross @ part.g[-OWN:]
        self._prior = np.diag(CORRELATED_PIXELS / lens.prior_sigma**2)
        self._off = lens.values - start.values

    def step(self) -> tuple[Lens, list[ImageState], float]:
        """Return the state after a step, and the step's largest share of what was known of a parameter before."""
        n = len(self._lens.names)
        gradient = self._gradients.sum(axis=0) + self._prior @ self._off
        shared = -np.linalg.solve(self._H + self._prior, gradient)
        states = []
        for part, inverse, state in zip(self._parts, self._inverse, self._states, strict=True):
            states.append(state.moved(-inverse @ (part.g[-OWN:] + part.H[-OWN:, :n] @ shared)))
        precision = np.sqrt(np.diagonal(np.linalg.inv(self._H + self._prior)) * CORRELATED_PIXELS)
        return self._lens.moved(shared), states, float(np.max(np.abs(shared) / precision))

    def result(self) -> RefinedCamera:
        """Return the estimate with the covariance of clustered data, wider where little was known beforehand, too."""
        count = len(self._parts)
        inverse = np.linalg.inv(self._H + self._prior)
        scatter = self._gradients - self._gradients.mean(axis=0)
        told = scatter.T @ scatter * count / (count - 1)
        covariance = inverse @ (told + self._prior * CORRELATED_PIXELS) @ inverse
        covariance += np.diag((FLOOR * self._lens.prior_sigma) ** 2)
        num_pixels = sum(part.num_pixels for part in self._parts)
        residual = float(np.median([part.sigma for part in self._parts]))
        return RefinedCamera(self._lens, covariance, tuple(self._states), num_pixels, residual)
