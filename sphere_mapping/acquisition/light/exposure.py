"""Factors of whole images: applied, and found from the ratios of grey levels that images share."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

DARKEST, BRIGHTEST = 10, 245  # grey levels between which exposures are compared
MIN_SHARED = 50  # directions from which on two cameras are compared
STEADINESS = 1e-3  # weight of 'no change' against one comparison, so that lone cameras are determined
WHITE = 235  # grey level above which what is darkened rises to 255 again: nobody knows how bright it was


def apply_gain(image: Image, gain: NDArray[np.float64]) -> Image:
    """Return the image (h, w[, 3]) times its gain (channels,); what is white stays white."""
    if np.all(np.abs(gain - 1.0) < 1e-3):
        return image
    before = np.arange(256)[:, None]
    after = before * gain
    rise = (before - WHITE) / (255 - WHITE)
    after = np.where((rise > 0) & (gain < 1.0), WHITE * gain + rise * (255 - WHITE * gain), after)
    levels = np.clip(np.rint(after), 0, 255).astype(np.uint8)
    return cv2.LUT(image, levels.reshape(1, 256, -1)).reshape(image.shape)


def log_gains(
    ratios: Sequence[tuple[int, int, NDArray[np.float64]]], number: int, channels: int
) -> NDArray[np.float64]:
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


def log_ratio(first: NDArray, second: NDArray) -> NDArray[np.float64] | None:
    """Return the logarithm (channels,) of the median ratio of levels (N, channels), None where too little compares."""
    fits = np.all((first > DARKEST) & (first < BRIGHTEST) & (second > DARKEST) & (second < BRIGHTEST), axis=1)
    if np.count_nonzero(fits) < MIN_SHARED:
        return None
    return np.median(np.log(first[fits] / second[fits]), axis=0)
