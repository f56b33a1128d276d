"""Does the belief still stand out from the rest of the map? If not, new particles (augmented Monte Carlo localisation).

A similarity alone says little: it depends on light and texture. So every image is also compared with some fixed
positions all over the area, the scouts; the lead of the belief is counted in standard deviations of theirs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness.similarity_cache import Comparison
from mcl_depth.params import RecoveryParams

Array = NDArray[np.float64]


class Recovery:
    """Short-term and long-term averages of the lead (Thrun, Burgard, Fox, table 8.3)."""

    def __init__(self, params: RecoveryParams, scouts: Array) -> None:
        """`scouts` (K, 2) m are positions all over the area."""
        self._params, self._scouts = params, scouts
        self.reset()

    def reset(self) -> None:
        """Forget all images."""
        self.fast = self.slow = 0.0
        self._num_images = 0

    def observe(self, comparison: Comparison, similarity: float) -> float:
        """Take the similarity of the belief with an image; return the lead averaged over the last few images."""
        lead = self.lead(comparison, similarity)
        self._num_images += 1
        if similarity <= 0.0:  # off the map: no need to ask others
            self.fast = 0.0
            return 0.0
        fast = max(self._params.fast_rate, 1.0 / self._num_images)
        slow = max(self._params.slow_rate, 1.0 / self._num_images)
        self.fast += fast * (lead - self.fast)
        self.slow += slow * (lead - self.slow)
        return self.fast

    def lead(self, comparison: Comparison, similarity: float) -> float:
        """Return by how many standard deviations a similarity exceeds the mean of some scouts at their best."""
        if not len(self._scouts):
            return 0.0
        first = self._num_images * self._params.scouts_per_image
        chosen = (first + np.arange(min(self._params.scouts_per_image, len(self._scouts)))) % len(self._scouts)
        best = comparison.curves(self._scouts[chosen]).max(axis=1).astype(np.float64)
        best = best[best > 0.0]
        if len(best) < 2:
            return 0.0
        return float((similarity - best.mean()) / max(float(best.std()), 1e-3 * float(best.mean())))

    def share(self, *, is_following: bool) -> float:
        """Return the share of the particles to be spread anew."""
        p = self._params
        if not p.is_active:
            return 0.0
        if not is_following:
            return p.lost_share
        if self.slow <= 0.0:
            return 0.0
        return float(np.clip(1.0 - self.fast / (p.fall * self.slow), 0.0, p.max_share))
