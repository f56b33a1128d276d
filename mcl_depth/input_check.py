"""Is this image worth comparing? By stamps and pixels alone: a replay decides alike (FIELD 6.2: F2, F4, F5, F8)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from localization.status import Reason
from mcl_depth.params import InputParams
from mcl_depth.reasons import FINE, Finding
from sphere_geometry import Camera

SAMPLE_STEP = 4  # every fourth pixel of every fourth row is enough for contrast and equality


class InputCheck:
    """Checks of one camera's stream, in order: stamp, size, numbers, contrast, freshness."""

    def __init__(self, params: InputParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Forget the stream."""
        self.last_stamp_ns: int | None = None
        self.is_new_time = False  # the image last checked begins a new time: forget everything with a stamp
        self._pending: list[int] = []
        self._sample: NDArray[Any] | None = None
        self._num_repeats = 0

    def check(self, image: NDArray[Any], camera: Camera, stamp_ns: int) -> Finding:
        """Judge a grey image (H, W); FINE where it may be used."""
        finding = self.check_stamp(stamp_ns)
        if finding is not FINE:
            return finding
        if image.shape != (camera.height, camera.width):
            expected, found = f"{camera.width} x {camera.height}", f"{image.shape[-1]} x {image.shape[0]}"
            return Finding(Reason.BAD_INFO, detail=f"image size: expected {expected} (camera_info), found {found}")
        sample = image[::SAMPLE_STEP, ::SAMPLE_STEP]
        if image.dtype.kind == "f" and not np.all(np.isfinite(sample)):
            return Finding(Reason.LOW_TEXTURE, detail="pixels that are no numbers")
        contrast = float(np.std(sample))
        if contrast < self._params.min_contrast:
            return Finding(Reason.LOW_TEXTURE, contrast, self._params.min_contrast, "image has no contrast")
        return self._check_frozen(sample)

    def check_stamp(self, stamp_ns: int) -> Finding:
        """Refuse zero, repeated, backward and leaping stamps, until several in a row agree on the new time."""
        last, limit = self.last_stamp_ns, self._params.max_leap_s
        self.is_new_time = False
        if stamp_ns <= 0:
            return Finding(Reason.BAD_STAMP, stamp_ns * 1e-9, 0.0, "stamp is zero or negative")
        if last is not None and not 0.0 < (stamp_ns - last) * 1e-9 <= limit:
            if stamp_ns == last:
                return Finding(Reason.BAD_STAMP, 0.0, 0.0, "stamp repeated")
            if not self._agrees(stamp_ns):
                step = (stamp_ns - last) * 1e-9
                return Finding(Reason.BAD_STAMP, step, limit, f"stamp leaps by {step:.3f} s")
            self.is_new_time = True
        self._pending.clear()
        self.last_stamp_ns = stamp_ns
        return FINE

    def _agrees(self, stamp_ns: int) -> bool:
        if self._pending and not 0.0 < (stamp_ns - self._pending[-1]) * 1e-9 <= self._params.max_leap_s:
            self._pending.clear()
        self._pending.append(stamp_ns)
        return len(self._pending) >= self._params.clock_jump_images

    def _check_frozen(self, sample: NDArray[Any]) -> Finding:
        is_repeat = self._sample is not None and np.array_equal(sample, self._sample)
        self._num_repeats = self._num_repeats + 1 if is_repeat else 0
        self._sample = sample.copy()
        limit = self._params.frozen_images
        if self._num_repeats >= limit and not self._params.allow_still:
            return Finding(Reason.FROZEN, self._num_repeats, limit, "identical images with new stamps")
        return FINE
