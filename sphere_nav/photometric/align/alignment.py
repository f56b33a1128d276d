"""What a registration found, and whether it may be used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3

GOOD, LOW_OVERLAP, LOW_TEXTURE = "", "LOW_OVERLAP", "LOW_TEXTURE"
NO_CONVERGENCE, OUTLIERS = "NO_CONVERGENCE", "OUTLIERS"


@dataclass(frozen=True)
class Alignment:
    """Result of `register`. When `reason` is not empty the pose is the last one tried, not to be used.

    covariance (6, 6) is that of xi in T_world_camera @ exp(xi), (v, omega); infinite on the diagonal where nothing
    is known. overlap is the share of the current image that the references cover, mad in grey levels, ncc the
    normalised cross correlation of the warped image, gains and biases map current grey levels to each reference's.
    """

    T_world_camera: SE3
    covariance: NDArray[np.float64]
    reason: str
    iterations: int
    num_pixels: int
    overlap: float
    inlier_share: float
    mad: float
    ncc: float
    gains: tuple[float, ...]
    biases: tuple[float, ...]

    @property
    def is_converged(self) -> bool:
        """Whether the result may be used."""
        return self.reason == GOOD
