"""Does a predicted motion move the last images onto the present ones? Where it does not, the rotation is measured.

M15 section 5.2: between two images rotation dominates, and the coarsest level shows it (eq. 20). Asking costs a few
hundred pixels; measuring costs an alignment, so it is done only where the answer is no.
"""

from __future__ import annotations

from collections.abc import Sequence

from dense_localizer.constants import IMAGE_FORGETTING, MAX_MISMATCH_RATIO, MAX_ROTATION_MISMATCH, MISMATCH_FLOOR
from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.align.rotation import correlation_after_turn, register_rig_rotation


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
        """Return a measured rotation (eq. 20) where images do not support a predicted motion but support that one."""
        predicted = measure_mismatch(images, self.images, T_before_now)
        if predicted is None:
            return None
        limit = None if self._usual is None else MAX_MISMATCH_RATIO * self._usual + MISMATCH_FLOOR
        is_supported = limit is not None and predicted <= limit
        measured = None if is_supported else register_rig_rotation(images, self.images, self._params)
        residual = predicted if measured is None else measure_mismatch(images, self.images, measured)
        if residual is None or residual > MAX_ROTATION_MISMATCH * predicted:
            measured, residual = None, predicted
        usual, weight = self._usual, IMAGE_FORGETTING
        self._usual = residual if usual is None else weight * usual + (1.0 - weight) * residual
        return measured


def measure_mismatch(now: Sequence[RigImage], before: Sequence[RigImage], T_before_now: SE3) -> float | None:
    """Return one minus the correlation of images and the ones before, turned by the rotation of a motion of the body.

    At the coarsest level, by the first camera that has both images; None where none has, or too little is seen.
    """
    earlier = {image.name: image for image in before}
    for image in now:
        if image.name in earlier:
            R = T_before_now.rotation
            if image.T_body_camera is not None:
                R = image.T_body_camera.rotation.T @ R @ image.T_body_camera.rotation
            correlation = correlation_after_turn(image.pyramid.levels[-1], earlier[image.name].pyramid.levels[-1], R)
            return None if correlation is None else 1.0 - correlation
    return None
