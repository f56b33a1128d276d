"""Is a held place still the right one? A sequential test, image by image, of how far it stands out of its surroundings.

A vehicle that is carried off, or a place that was chance, shows in the images to come: the held place fits them no
better than any. Each image gives a figure of merit, `excess`, in standard deviations of what other headings reach:
about zero at a random place, and around its own mean as long as the place is right. The cumulative sum of the log
likelihood ratio of these two (Page 1954) is the quickest test of such a change; while nothing changes, it passes
log(1 / rate) less than once in 1 / rate images (Lorden 1971).

A place that was given from outside is confirmed by the same figure: by the sequential probability ratio test (Wald
1945), from even odds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import (
    FIRST_MEAN,
    FIRST_SIGMA,
    MAX_EXCESS,
    MAX_LOG_RATIO_STEP,
    MEMORY,
    MIN_MEAN,
    MIN_SIGMA,
    NEAR,
    NEWS,
    OTHER_HEADINGS,
)

Patch = NDArray[np.float32]


def excess(patch: Patch, heading: int) -> float:
    """Return how far the middle of a patch (A, n, n) stands out at a heading: against all other headings there.

    patch: what an image makes of the headings and cells around a place, NaN where there is no cell. What a heading has
    in all cells of the patch is taken off, and the best of neighbouring cells and headings counts.
    """
    local = patch - np.nanmean(patch, axis=(1, 2), keepdims=True)
    middle = patch.shape[1] // 2
    near = slice(middle - NEAR, middle + NEAR + 1)
    best = np.nan_to_num(local, nan=-np.inf)[:, near, near].max(axis=(1, 2))
    best = np.max([np.roll(best, step) for step in range(-NEAR, NEAR + 1)], axis=0)
    steps = np.abs(np.arange(len(best)) - heading)
    others = best[np.minimum(steps, len(best) - steps) > OTHER_HEADINGS]
    return float((best[heading] - others.mean()) / max(float(others.std()), 1e-9))


class CusumTest:
    """The cumulative sum for a held place."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin with another place."""
        self.log_ratio = 0.0  # of the likelihood of a random place to that of the right one
        self._mean, self._variance = FIRST_MEAN, FIRST_SIGMA**2

    def add(self, value: float) -> None:
        """Add the excess that an image gives."""
        step = log_ratio_of(value, self._mean, self._variance)
        if step < 0.0:
            off = min(value, MAX_EXCESS) - self._mean
            self._mean = max(self._mean + (1.0 - MEMORY) * off, MIN_MEAN)
            self._variance = max(MEMORY * self._variance + (1.0 - MEMORY) * off**2, MIN_SIGMA**2)
        self.log_ratio = max(self.log_ratio + step, 0.0)

    def suspect(self) -> None:
        """Count the worst that an image can say of the place: the vehicle may have been carried off."""
        self.log_ratio += MAX_LOG_RATIO_STEP

    def p_chance(self, prior: float) -> float:
        """Return the probability that the place is not the right one (any more), from that before the first image."""
        odds = prior / max(1.0 - prior, 1e-12) * np.exp(min(self.log_ratio, 50.0))
        return float(odds / (1.0 + odds))


class WaldTest:
    """Wald's test of a place that was given: right or not, until one of them is as sure as is asked."""

    def __init__(self) -> None:
        self._log_ratio = 0.0  # of the likelihood of a random place to that of the right one

    def add(self, value: float) -> None:
        """Add the excess that an image gives."""
        self._log_ratio += NEWS * log_ratio_of(value, FIRST_MEAN, FIRST_SIGMA**2)

    @property
    def p_chance(self) -> float:
        """Probability that the place is not the right one."""
        return float(1.0 / (1.0 + np.exp(np.clip(-self._log_ratio, -50.0, 50.0))))

    def is_refused(self, max_chance: float) -> bool:
        """Whether it is as surely wrong as a place that is accepted is right."""
        return self._log_ratio > np.log(1.0 / max_chance)


def log_ratio_of(value: float, mean: float, variance: float) -> float:
    """Return log N(value; 0, variance) - log N(value; mean, variance), within `MAX_LOG_RATIO_STEP`."""
    ratio = 0.5 * mean * (mean - 2.0 * min(value, MAX_EXCESS)) / variance
    return float(np.clip(ratio, -MAX_LOG_RATIO_STEP, MAX_LOG_RATIO_STEP))
