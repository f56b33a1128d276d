"""What the electronics of a camera do to the brightness: automatic exposure that comes late, drifting white balance."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import ImagingParams
from cycab_sim.sensors.faults import SECOND

Floats = NDArray[np.float32]
STRIDE = 4  # every 4th row and column are measured
DRIFT_WAVES = np.array([1.0, 1.7, 2.9])  # the white balance drifts with these multiples of its rate


class Exposure:
    """The common exposure of a group of cameras; deterministic: it depends on the images seen so far and the stamps."""

    def __init__(self, params: ImagingParams, gamma: float, seed: tuple[int, ...]) -> None:
        self.params = params
        self._gamma = gamma
        self._gain, self._wanted = 1.0, 1.0
        self._now_ns: int | None = None
        self._seen: deque[tuple[int, float]] = deque()
        self._phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, (2, len(DRIFT_WAVES)))

    def gains(self, stamp_ns: int) -> NDArray[np.float64]:
        """Return the factors on red, green and blue light (3,) for an image of this instant."""
        if self.params.has_automatic_exposure and stamp_ns != self._now_ns:
            self._follow(stamp_ns)
        return self._gain * self._balance(stamp_ns / SECOND)

    def observe(self, stamp_ns: int, levels: Floats) -> None:
        """Measure an image (H, W[, 3]) that was taken with the present gain; 0: outside the lens."""
        if not self.params.has_automatic_exposure:
            return
        some = levels[::STRIDE, ::STRIDE]
        mean = float(some[some > 0.0].mean()) if (some > 0.0).any() else self.params.target
        self._seen.append((stamp_ns, math.log(self._gain) + self._gamma * math.log(self.params.target / mean)))

    def _follow(self, stamp_ns: int) -> None:
        """Move towards what the images called for that are known by now."""
        p = self.params
        known: dict[int, list[float]] = {}
        while self._seen and self._seen[0][0] + round(p.exposure_delay * SECOND) <= stamp_ns:
            stamp, wanted = self._seen.popleft()
            known.setdefault(stamp, []).append(wanted)
        if known:
            limit = math.log(p.range)
            self._wanted = math.exp(min(max(float(np.mean(known[max(known)])), -limit), limit))
        seconds = 0.0 if self._now_ns is None else (stamp_ns - self._now_ns) / SECOND
        share = -math.expm1(-seconds / p.exposure_lag) if p.exposure_lag > 0.0 else 1.0
        self._gain *= (self._wanted / self._gain) ** share
        self._now_ns = stamp_ns

    def _balance(self, seconds: float) -> NDArray[np.float64]:
        """Return factors (3,) on the colours; green stays."""
        p = self.params
        if p.white_balance == 0.0:
            return np.ones(3)
        angles = 2 * np.pi * DRIFT_WAVES * seconds / p.white_balance_period + self._phases
        red, blue = np.exp(p.white_balance * np.sqrt(2.0 / len(DRIFT_WAVES)) * np.sin(angles).sum(axis=1))
        return np.array([red, 1.0, blue])


def averaged(draw: Callable[[float], tuple[Floats, Floats]], shutter: float, num: int, gamma: float) -> Floats:
    """Return the levels of an open shutter: the mean light of `num` instants, seconds before and after the middle.

    draw(offset s) returns levels 0..255 and ranges of an instant.
    """
    offsets = (np.arange(num) + 0.5) / num - 0.5
    total = sum((draw(float(shutter * offset))[0] / np.float32(255.0)) ** np.float32(gamma) for offset in offsets)
    return np.asarray(np.float32(255.0) * (total / np.float32(num)) ** np.float32(1.0 / gamma), dtype=np.float32)
