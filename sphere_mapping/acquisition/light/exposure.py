"""Factors of whole images: applied, and found from ratios of grey levels that images share."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from sphere_mapping.acquisition.constants import STEADINESS, WHITE
from sphere_nav.geometry.arrays import Array, Bytes


def apply_gain(image: Bytes, gain: Array) -> Bytes:
    """Return the image (h, w[, 3]) times its gain (channels,); what is white stays white."""
    if np.all(np.abs(gain - 1.0) < 1e-3):
        return image
    before = np.arange(256)[:, None]
    after = before * gain
    rise = (before - WHITE) / (255 - WHITE)
    after = np.where((rise > 0) & (gain < 1.0), WHITE * gain + rise * (255 - WHITE * gain), after)
    levels = np.clip(np.rint(after), 0, 255).astype(np.uint8)
    return cv2.LUT(image, levels.reshape(1, 256, -1)).reshape(image.shape)


def log_gains(ratios: Sequence[tuple[int, int, Array]], number: int, channels: int) -> Array:
    """Return the logarithms (number, channels), mean 0, of the factors that make what was compared agree best.

    ratios: numbers of two images and the logarithm (channels,) of the ratio of the first one's levels to the second's.
    """
    rows, values = [STEADINESS * np.eye(number)], [np.zeros((number, channels))]
    for first, second, ratio in ratios:
        row = np.zeros((1, number))
        row[0, first], row[0, second] = 1.0, -1.0
        rows.append(row)
        values.append(-ratio[None])
    logs = np.linalg.lstsq(np.vstack(rows), np.vstack(values), rcond=None)[0]
    return logs - logs.mean(axis=0)
