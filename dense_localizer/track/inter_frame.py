"""Does a predicted motion move the last images onto the present ones? Where it does not, the rotation is measured.

M15 section 5.2: between two images rotation dominates, and the coarsest level shows it (eq. 20). Asking costs a few
hundred pixels; measuring costs an alignment, so it is done only where the answer is no.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dense_localizer.constants import IMAGE_FORGETTING, MAX_MISMATCH_RATIO, MAX_ROTATION_MISMATCH, MISMATCH_FLOOR
from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams, register_rotation
from sphere_nav.photometric.align.esm import correlation_after_turn
from sphere_nav.photometric.align.problem import RigImage


class InterFrame:
    """Keeps the last images and how well predictions have matched them."""

    def __init__(self, params: RegistrationParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Nothing is known of the stream."""
        self.images: tuple[RigImage, ...] = ()  # the last ones, placed or not
        self._usual: float | None = None  # mismatch of predictions

    def refine(self, images: Sequence[RigImage], T_before_now: SE3) -> SE3 | None:
        """Return a measured rotation (eq. 20) where images do not support a predicted motion but support that one.

        By the first camera of which there are both images.
        """
        earlier = {image.name: image.pyramid for image in self.images}
        image = next((one for one in images if one.name in earlier), None)
        if image is None:
            return None
        pair, R_body_camera = (image.pyramid, earlier[image.name]), image.mount.rotation
        before = correlation_after_turn(*pair, R_body_camera.T @ T_before_now.rotation @ R_body_camera)
        if before is None:
            return None
        predicted = residual = 1.0 - before
        measured: SE3 | None = None
        if self._usual is None or predicted > MAX_MISMATCH_RATIO * self._usual + MISMATCH_FLOOR:
            R_camera = register_rotation(*pair, self._params).rotation
            after = correlation_after_turn(*pair, R_camera)
            if after is not None and 1.0 - after <= MAX_ROTATION_MISMATCH * predicted:
                measured = SE3.from_parts(R_body_camera @ R_camera @ R_body_camera.T, np.zeros(3))
                residual = 1.0 - after
        usual, weight = self._usual, IMAGE_FORGETTING
        self._usual = residual if usual is None else weight * usual + (1.0 - weight) * residual
        return measured
