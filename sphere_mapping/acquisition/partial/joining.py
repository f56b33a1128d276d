"""Several views of one instant -> one whole sphere: exposures made equal, images blended, range of the best view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import FEATHER_PX
from sphere_mapping.acquisition.light.exposure import log_gains, log_ratio
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Array, Bytes, Floats
from sphere_nav.spheres.sphere import to_gray


@dataclass(frozen=True, eq=False)
class Patch:
    """One view in its window of the sphere; weight (h, w) is the distance to the view's border in pixels, 0 outside."""

    image: Bytes
    range_m: Floats
    weight: Floats
    window: Spherical

    def window_in(self, whole: Spherical) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows (h, 1) and columns (1, w) of the window in the whole sphere; columns wrap around."""
        rows = np.arange(self.window.height) + int(self.window.offset_v)
        columns = (np.arange(self.window.width) + int(self.window.offset_u)) % whole.width
        return rows[:, None], columns[None, :]


def join_views(patches: Sequence[Patch], whole: Spherical) -> tuple[Bytes, Floats]:
    """Return image and range (H, W) of the whole sphere; 0 and NaN where no view is."""
    shape = (whole.height, whole.width)
    depth_of_color = patches[0].image.shape[2:]
    total, weights = np.zeros((*shape, *depth_of_color), np.float32), np.zeros(shape, np.float32)
    range_m, best = np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
    for patch, gain in zip(patches, exposure_gains(patches, whole), strict=True):
        window = patch.window_in(whole)
        share = np.minimum(patch.weight, FEATHER_PX)
        weights[window] += share
        total[window] += gain * patch.image * (share[..., None] if depth_of_color else share)
        weight = np.where(np.isnan(patch.range_m), 0, patch.weight)
        range_m[window] = np.where(weight > best[window], patch.range_m, range_m[window])
        best[window] = np.maximum(best[window], weight)
    scale = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0)
    image = total * (scale[..., None] if depth_of_color else scale)
    seen = weights > 0
    image = np.clip(np.rint(image), 1, 255) * (seen[..., None] if depth_of_color else seen)
    return image.astype(np.uint8), range_m


def exposure_gains(patches: Sequence[Patch], whole: Spherical) -> Floats:
    """Return the factor (N,) of each view that makes overlapping views agree best, geometric mean 1."""
    grays = [_on_sphere(patch, whole) for patch in patches]
    ratios = []
    for i, j in combinations(range(len(patches)), 2):
        if (ratio := _log_ratio(grays[i], grays[j])) is not None:
            ratios.append((i, j, ratio))
    return np.exp(log_gains(ratios, len(patches), 1)[:, 0]).astype(np.float32)


def _on_sphere(patch: Patch, whole: Spherical) -> dict[str, NDArray]:
    """Return the index (M,) of the pixels of a view in the whole sphere, in order, and their grey levels."""
    usable = patch.weight > 1
    rows, columns = patch.window_in(whole)
    index = (rows * whole.width + columns)[usable]
    order = np.argsort(index)
    return {"index": index[order], "grey": to_gray(patch.image)[usable][order].astype(np.float64)}


def _log_ratio(a: dict[str, NDArray], b: dict[str, NDArray]) -> Array | None:
    """Return the logarithm (1,) of the median ratio of grey levels a / b where both see."""
    _, in_a, in_b = np.intersect1d(a["index"], b["index"], assume_unique=True, return_indices=True)
    return log_ratio(a["grey"][in_a][:, None], b["grey"][in_b][:, None])
