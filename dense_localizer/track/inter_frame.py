"""Does a predicted motion move the last images onto the present ones? Where it does not, the rotation is measured.

M15 section 5.2: between two images rotation dominates, and the coarsest level shows it (eq. 20). Asking costs a few
hundred pixels; measuring costs an alignment, so it is done only where the answer is no.
"""

from __future__ import annotations

from collections.abc import Sequence

from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.align.rotation import correlation_after_turn, register_rig_rotation

MAX_RATIO, FLOOR = 3.0, 0.02  # mismatch of a prediction that is not supported, by what others left, and beyond it
KEPT = 0.9  # of the weight of earlier predictions, from one to the next
GAIN = 0.7  # a measured rotation must leave less than this share of the mismatch


class InterFrame:
    """Keeps the last images and how well predictions have matched them."""

    def __init__(self, params: RegistrationParams) -> None:
        self._params = params
        self.forget()

    def forget(self) -> None:
        """Nothing is known of the stream."""
        self.before: tuple[RigImage, ...] = ()
        self._usual: float | None = None  # mismatch

    def measure(self, images: Sequence[RigImage]) -> SE3 | None:
        """Return T_before_now of the body, a pure rotation, measured (eq. 20); None without images of one camera."""
        return register_rig_rotation(images, self.before, self._params)

    def refine(self, images: Sequence[RigImage], T_before_now: SE3) -> SE3 | None:
        """Return a measured rotation where the images do not support a predicted motion but do support that one."""
        found = mismatch(images, self.before, T_before_now)
        if found is None:
            return None
        is_supported = self._usual is not None and found <= MAX_RATIO * self._usual + FLOOR
        measured = None if is_supported else self.measure(images)
        left = found if measured is None else mismatch(images, self.before, measured)
        if left is None or left > GAIN * found:
            measured, left = None, found
        self._usual = left if self._usual is None else KEPT * self._usual + (1.0 - KEPT) * left
        return measured


def mismatch(now: Sequence[RigImage], before: Sequence[RigImage], T_before_now: SE3) -> float | None:
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
