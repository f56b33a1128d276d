"""Whether two images are in the order that is claimed: exchanged ones match nowhere, or far away everywhere."""

from __future__ import annotations

import cv2
import numpy as np

from sphere_mapping.acquisition.constants import EXCHANGED, ORDER_COLUMNS
from sphere_mapping.acquisition.range.semi_global import Image, find_clear_matches


def check_order(top: Image, bottom: Image, names: tuple[str, str], *, is_whole: bool) -> None:
    """Raise ValueError if grey images (H, W) match with positive disparity only when they are exchanged.

    Disparities below one pixel of the shrunk images count for neither order: far scenes are no evidence.
    """
    small = [_shrink(image) for image in (top, bottom)]
    given, exchanged = (_share_matched(a, b, is_whole) for a, b in (small, small[::-1]))
    least, factor = EXCHANGED
    if exchanged > least and exchanged > factor * given:
        first, second = names
        raise ValueError(
            f"{first} and {second} image: expected disparities above 0, found {given:.0%} of the pixels matched, and "
            f"{exchanged:.0%} with the images exchanged"
        )


def _share_matched(top: Image, bottom: Image, is_whole: bool) -> float:
    found = find_clear_matches(top, bottom, 0, is_whole=is_whole)
    return float(np.mean(np.nan_to_num(found, nan=0.0) > 1.0))


def _shrink(image: Image) -> Image:
    factor = max(max(image.shape) / ORDER_COLUMNS, 1.0)
    size = (round(image.shape[1] / factor), round(image.shape[0] / factor))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
