"""Is this image worth a look? Everything that can be said before the map is asked (FIELD 6.2: F2, F4, F5, F8, F9).

Decisions depend on stamps and pixels only, never on a clock of the computer, so that a replay repeats them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera
from sphere_nav.localization.constants import (
    BRIGHT_LEVEL,
    CLOCK_JUMP_IMAGES,
    DARK_LEVEL,
    FROZEN_IMAGES,
    MAX_CLIPPED_SHARE,
    MIN_CONTRAST,
    SAMPLE_STEP,
)
from sphere_nav.localization.params import InputParams
from sphere_nav.localization.status import FINE, Reason, Verdict


@dataclass(frozen=True)
class InputReport:
    """What the checks say; after a `clock_jump` everything with a stamp is to be forgotten."""

    finding: Verdict = FINE
    is_clock_jump: bool = False

    @property
    def is_good(self) -> bool:
        """Whether the image may be used."""
        return self.finding.reason is Reason.NONE


class InputCheck:
    """Checks of one camera's stream, in order: stamp, size, calibration, numbers, light, freshness."""

    def __init__(self, params: InputParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Forget the stream."""
        self.last_stamp_ns: int | None = None
        self._pending_stamps: list[int] = []
        self._camera: Camera | None = None
        self._last_sample: NDArray[Any] | None = None
        self._num_repeats = 0

    def check(self, image: NDArray[Any], camera: Camera, stamp_ns: int, *, is_moving: bool = False) -> InputReport:
        """Judge a grey image (H, W); `is_moving` says whether the camera is known to have moved when last seen."""
        report = self.check_stamp(stamp_ns)
        if not report.is_good:
            return report
        return InputReport(self.check_image(image, camera, is_moving=is_moving), report.is_clock_jump)

    def check_stamp(self, stamp_ns: int) -> InputReport:
        """Judge a stamp alone; after a jump of the clock the stream begins anew.

        Zero, repeated, backward and leaping stamps are refused, until several in a row agree on the new time.
        """
        last, max_leap_s = self.last_stamp_ns, self._params.max_leap_s
        if stamp_ns <= 0:
            return _refuse_stamp(stamp_ns * 1e-9, 0.0, "stamp is zero or negative")
        if stamp_ns == last:
            return _refuse_stamp(0.0, 0.0, "stamp repeated")
        step = 0.0 if last is None else (stamp_ns - last) * 1e-9
        is_clock_jump = not 0.0 <= step <= max_leap_s
        if is_clock_jump and not self._is_new_time(stamp_ns):
            word, limit = ("backward", 0.0) if step < 0 else ("leaps forward", max_leap_s)
            return _refuse_stamp(step, limit, f"stamp {word} by {abs(step):.3f} s")
        if is_clock_jump:
            self.reset()
        self._pending_stamps.clear()
        self.last_stamp_ns = stamp_ns
        return InputReport(is_clock_jump=is_clock_jump)

    def check_image(self, image: NDArray[Any], camera: Camera, *, is_moving: bool = False) -> Verdict:
        """Judge an image (H, W) without its stamp."""
        finding = self._check_camera(image, camera)
        if finding.reason is Reason.NONE:
            sample = np.ascontiguousarray(image[::SAMPLE_STEP, ::SAMPLE_STEP])
            finding = self._check_pixels(image, sample, is_moving)
        return finding

    def find_silence(self, elapsed_s: float, finding: Verdict = FINE) -> tuple[int, Verdict] | None:
        """Return the present stamp and what to say so long after the last usable image, if that is too long.

        `finding` says why the images since then could not be used; without one none has come.
        """
        if self.last_stamp_ns is None or elapsed_s <= self._params.timeout_s:
            return None
        timeout = Verdict(Reason.TIMEOUT, elapsed_s, self._params.timeout_s)
        return self.last_stamp_ns + round(elapsed_s * 1e9), timeout if finding.reason is Reason.NONE else finding

    def _is_new_time(self, stamp_ns: int) -> bool:
        pending = self._pending_stamps
        if pending and not 0 < (stamp_ns - pending[-1]) * 1e-9 <= self._params.max_leap_s:
            pending.clear()
        pending.append(stamp_ns)
        return len(pending) >= CLOCK_JUMP_IMAGES

    def _check_camera(self, image: NDArray[Any], camera: Camera) -> Verdict:
        if image.shape != (camera.height, camera.width):
            expected, found = f"{camera.width} x {camera.height}", f"{image.shape[-1]} x {image.shape[0]}"
            detail = f"image size: expected {expected} (camera_info), found {found}"
            return Verdict(Reason.BAD_INFO, float(image.shape[-1]), float(camera.width), detail)
        if self._camera is not None and self._camera != camera:
            return Verdict(Reason.BAD_INFO, detail="camera_info changed while running; call reset to accept it")
        self._camera = camera
        return FINE

    def _check_pixels(self, image: NDArray[Any], sample: NDArray[Any], is_moving: bool) -> Verdict:
        if image.dtype.kind == "f" and not np.isfinite(np.sum(image)):
            num_bad = int(np.sum(~np.isfinite(image)))
            return Verdict(Reason.LOW_TEXTURE, num_bad, 0.0, "pixels that are no numbers")
        finding = self._check_light(sample)
        return finding if finding.reason is not Reason.NONE else self.check_frozen(sample, is_moving=is_moving)

    def _check_light(self, sample: NDArray[Any]) -> Verdict:
        for is_clipped, word in ((sample <= DARK_LEVEL, "black"), (sample >= BRIGHT_LEVEL, "saturated")):
            share = float(np.mean(is_clipped))
            if share > MAX_CLIPPED_SHARE:
                return Verdict(Reason.LOW_TEXTURE, share, MAX_CLIPPED_SHARE, f"image is {word}")
        contrast, limit = float(cv2.meanStdDev(sample)[1].item()), MIN_CONTRAST
        return Verdict(Reason.LOW_TEXTURE, contrast, limit, "image has no contrast") if contrast < limit else FINE

    def check_frozen(self, sample: NDArray[Any], *, is_moving: bool = False) -> Verdict:
        """Judge whether pixels (numbers) are new, of an image or of depth."""
        is_repeat = self._last_sample is not None and np.array_equal(sample, self._last_sample)
        self._num_repeats = self._num_repeats + 1 if is_repeat else 0
        if not is_repeat:
            self._last_sample = sample
        if self._num_repeats >= FROZEN_IMAGES and (is_moving or not self._params.allow_still):
            return Verdict(Reason.FROZEN, self._num_repeats, FROZEN_IMAGES, "identical images with new stamps")
        return FINE


def _refuse_stamp(value: float, limit: float, detail: str) -> InputReport:
    return InputReport(Verdict(Reason.BAD_STAMP, value, limit, detail))
