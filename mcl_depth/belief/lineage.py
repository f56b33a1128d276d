"""Where each particle came from: the trajectory of the one with the highest accumulated weight (N17 figure 7)."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.particles import Particles

Array = NDArray[np.float64]
MAX_IMAGES = 5000  # that are remembered; 40 kB each with 1000 particles


class Lineage:
    """The particles of all images, each with its parent among those of the image before."""

    def __init__(self) -> None:
        self._images: deque[tuple[int, Array, NDArray[np.int64]]] = deque(maxlen=MAX_IMAGES)
        self._scores = np.zeros(0)

    def clear(self) -> None:
        """Forget all images."""
        self._images.clear()

    def add(self, stamp_ns: int, particles: Particles) -> Particles:
        """Remember the weighted particles of an image; return them as parents of the next."""
        self._images.append((stamp_ns, particles.poses, particles.parents))
        self._scores = particles.scores
        return replace(particles, parents=np.arange(len(particles), dtype=np.int64))

    def trajectory(self) -> list[tuple[int, Array]]:
        """Return stamps and poses (3,) of the particle of the highest score and its ancestors, oldest first."""
        if not self._images:
            return []
        index, found = int(np.argmax(self._scores)), []
        for stamp_ns, poses, parents in reversed(self._images):
            found.append((stamp_ns, poses[index]))
            index = int(parents[index])
            if index < 0:
                break
        return found[::-1]
