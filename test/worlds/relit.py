"""A room in another light: what stays are places of edges, of some of them the contrast is turned."""

from __future__ import annotations

import cv2
import numpy as np

from worlds.room import Room


class EdgedRoom(Room):
    """Walls painted in four greys, whose borders run in all directions."""

    def gray(self, points):
        is_small = np.arange(len(self.k)) % 2
        sums = self.waves(points, np.stack([1 - is_small, is_small], axis=1) * self.amplitude[:, None])
        return 40.0 + (sums > 0) @ [55.0, 110.0]


def relit(image, seed: int = 0):
    """Return a grey image (H, W) uint8 in shades, some patches of it as a negative, some of them something else."""
    rng = np.random.default_rng(seed)
    height, width = image.shape
    gray = image.astype(np.float32)
    is_negative, is_other = (_patches(rng, height, width) > limit for limit in (0.85, 0.85))
    gray = np.where(is_negative, 255.0 - gray, gray)
    gray = gray * (0.3 + 0.7 * _patches(rng, height, width, cv2.INTER_LINEAR))
    gray[is_other] = cv2.GaussianBlur(rng.uniform(0, 255, gray.shape).astype(np.float32), (0, 0), 2.0)[is_other]
    return np.clip(np.rint(gray), 1, 255).astype(np.uint8)


def _patches(rng, height, width, between=cv2.INTER_NEAREST):
    """Return uniform random numbers (H, W), one for each of 8 x 6 patches."""
    return cv2.resize(rng.random((6, 8)), (width, height), interpolation=between)
