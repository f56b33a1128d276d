"""Is a held place still the right one? A sequential test, image by image, of how far it stands out of its surroundings.

A vehicle that is carried off, or a place that was chance, shows in the images to come: the held place fits them no
better than any. Each image gives a figure of merit, `excess`, in standard deviations of what other headings reach:
about zero at a random place, and around four as long as the place is right. The cumulative sum of the log
likelihood ratio of these two (Page 1954) is the quickest test of such a change; while nothing changes, it passes
log(1 / rate) less than once in 1 / rate images (Lorden 1971).

A place that was given from outside is confirmed by the same figure: by the sequential probability ratio test (Wald
1945), from even odds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import APART, MAX_LOG_RATIO_STEP, NEWS, RIGHT_MEAN, RIGHT_SIGMA


def excess(curves: NDArray[np.float32], is_near: NDArray[np.bool_], heading: int) -> float:
    """Return how far the cells at a place stand out at a heading: against all other headings there.

    curves (K, A): what an image makes of the cells around the place, some of them at it (`is_near`). What a heading has
    in all of them is taken off, and the best of neighbouring cells and headings counts.
    """
    best = (curves - curves.mean(axis=0))[is_near].max(axis=0)
    best = np.maximum(best, np.maximum(np.roll(best, 1), np.roll(best, -1)))
    steps = np.abs(np.arange(len(best)) - heading)
    others = best[np.minimum(steps, len(best) - steps) > APART]
    return float((best[heading] - others.mean()) / max(float(others.std()), 1e-9))


class PlaceTest:
    """The log odds that a place is not the right one, image by image.

    A held place was right: the odds fall no lower than at first, so that they rise with the first images that speak
    against it. A place on trial is as probably right as wrong.
    """

    def __init__(self, max_chance: float, *, is_held: bool) -> None:
        """`max_chance`: a place that was accepted is chance so often; one is refused by as much."""
        self._max_chance, self._is_held = max_chance, is_held
        self._least = float(np.log(max_chance / max(1.0 - max_chance, 1e-12))) if is_held else -np.inf
        self._log_odds = self._least if is_held else 0.0

    def add(self, value: float) -> None:
        """Add the excess that an image gives."""
        step = log_ratio_of(value)
        self._log_odds = max(self._log_odds + (step if self._is_held else NEWS * step), self._least)

    @property
    def p_chance(self) -> float:
        """Probability that the place is not the right one."""
        return float(1.0 / (1.0 + np.exp(np.clip(-self._log_odds, -50.0, 50.0))))

    @property
    def is_confirmed(self) -> bool:
        """Whether it is as surely right as a place that is accepted."""
        return self.p_chance < self._max_chance

    def is_refused(self) -> bool:
        """Whether it is as surely wrong as a place that is accepted is right."""
        return bool(self._log_odds > np.log(1.0 / self._max_chance))


def log_ratio_of(value: float) -> float:
    """Return log N(value; 0, s) - log N(value; m, s), m, s those of a right place, within `MAX_LOG_RATIO_STEP`."""
    ratio = 0.5 * RIGHT_MEAN * (RIGHT_MEAN - 2.0 * value) / RIGHT_SIGMA**2
    return float(np.clip(ratio, -MAX_LOG_RATIO_STEP, MAX_LOG_RATIO_STEP))
