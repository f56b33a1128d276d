"""A pose that images may have been taken from, with all that speaks for and against it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import MAX_POSITION_SIGMA_M
from dense_localizer.judge.acceptance import Acceptance, refuse
from dense_localizer.motion_prior import Prediction, measure_position_sigma
from dense_localizer.references.reference import Choice
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.localization.constants import PROVEN_IMAGES
from sphere_nav.localization.status import Verdict
from sphere_nav.photometric import Alignment
from sphere_nav.photometric.align.problem import RigImage


@dataclass(frozen=True)
class PoseCandidate:
    """A pose with its covariance (6, 6), the prediction and references behind it, and whether it is accepted.

    No alignment: nothing to see. `images` are those that some reference covers, with their references.
    """

    T_map_camera: SE3
    covariance: NDArray[np.float64]
    prediction: Prediction
    choice: Choice
    acceptance: Acceptance
    alignment: Alignment | None = None
    motion: FrameMotion | None = None  # within the frame
    images: tuple[RigImage, ...] = ()
    is_biased: bool = False  # by an occlusion, uneven light or changes, where that was checked; the bias is removed
    is_by_map: bool = True  # else by the last images alone
    is_by_range: bool = False  # by geometry alone
    is_by_parts: bool = False  # parts of the view have proven it, however little the whole resembles the map
    is_proven: bool = False  # so many parts agree that the place is right, where they were asked

    def refuse(self, finding: Verdict) -> PoseCandidate:
        """Return it as one that is not used."""
        return replace(self, acceptance=refuse(finding))

    def join(self) -> PoseCandidate:
        """Return it with the pose that it and its prediction make together; one by the last images has it in it."""
        if not self.is_by_map:
            return self
        T_map_camera, covariance = self.prediction.join(self.T_map_camera, self.covariance)
        return replace(self, T_map_camera=T_map_camera, covariance=covariance)

    @property
    def is_accepted(self) -> bool:
        """Whether the pose may be used."""
        return self.acceptance.is_accepted

    @property
    def finding(self) -> Verdict:
        """The worst fact against it."""
        return self.acceptance.finding

    @property
    def is_rig(self) -> bool:
        """Whether the pose is that of a body which carries the cameras, not that of the one camera."""
        return len(self.images) != 1 or self.images[0].T_body_camera is not None

    @property
    def num_images(self) -> int:
        """How many images it counts for on probation."""
        return PROVEN_IMAGES if self.is_proven else 1

    @property
    def noise(self) -> NDArray[np.float64]:
        """The part (6, 6) of the covariance that the image brings, not the map."""
        return self.alignment.covariance if self.alignment is not None and not self.is_by_range else self.covariance

    @property
    def is_certain(self) -> bool:
        """Whether the position is known well enough to go on from."""
        return measure_position_sigma(self.covariance) <= MAX_POSITION_SIGMA_M

    @property
    def ncc(self) -> float:
        """How well the references explain the image, -1...1."""
        return self.alignment.ncc if self.alignment is not None and not self.is_by_range else -1.0
