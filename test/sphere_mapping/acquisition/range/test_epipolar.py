"""Range of two levels whose cameras stand beside the axis, in images joined for one distance: exact geometry."""

from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.acquisition.range.epipolar import correct_baseline, joined_share, to_common_center
from sphere_nav.geometry import Spherical

WHOLE = Spherical(256, 128)
BASELINE_M, JOINED_M = 0.3, 5.0
OFFSETS = np.float32([[0.03, 0.01, 0.005], [-0.03, 0.012, 0.0]])
OWNER = np.repeat((np.arange(256) >= 128).astype(np.int8)[None], 128, axis=0)
LAYOUT = SimpleNamespace(owner=OWNER, centers=OFFSETS)
RAYS = WHOLE.unproject(np.stack(np.meshgrid(np.arange(256), np.arange(128)), -1).astype(float))
INSIDE = np.abs(RAYS[..., 2]) < 0.8


def shown(distance_m):
    """Return the points (H, W, 3) of a sphere around the centre that the pixels of the upper level show."""
    offset = OFFSETS[OWNER].astype(float)
    ray = JOINED_M * RAYS - offset
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = np.sum(ray * offset, axis=-1)
    reach = -along + np.sqrt(along**2 + distance_m**2 - np.sum(offset**2, axis=-1))
    return offset + reach[..., None] * ray


def matched_range(points):
    """Return the range that follows from the disparity of points (H, W, 3), all cameras taken for the centres."""
    offset = OFFSETS[OWNER].astype(float)
    ray = points - offset + [0.0, 0.0, BASELINE_M]
    square, product = np.sum(ray**2, axis=-1), np.sum(ray * offset, axis=-1) / JOINED_M
    rest = np.sum(offset**2, axis=-1) / JOINED_M**2 - 1.0
    factor = (-product + np.sqrt(product**2 - square * rest)) / square
    pixel = offset / JOINED_M + factor[..., None] * ray  # of length 1: JOINED_M pixel - offset is along the ray
    above, below = (np.arccos(np.clip(direction[..., 2], -1.0, 1.0)) for direction in (RAYS, pixel))
    return BASELINE_M * (np.sin(above) / np.tan(above - below) - np.cos(above))


@pytest.mark.parametrize("distance_m", [1.5, 20.0])
def test_range_from_the_center_is_that_of_the_scene_wherever_the_images_were_joined(distance_m):
    range_m = matched_range(shown(distance_m)).astype(np.float32)
    std_m, shrink = 0.1 * range_m, 1.0 / (1.0 + joined_share(LAYOUT, 1.0 / JOINED_M))
    correct_baseline(range_m, std_m, np.zeros_like(range_m), shrink, 1.0 / JOINED_M)
    found, found_std = to_common_center(range_m, std_m, LAYOUT, 1.0 / JOINED_M)
    error = (found / distance_m - 1.0)[INSIDE]
    assert abs(np.median(error)) < 1e-4 + 0.5 * (0.033 / distance_m) ** 2
    assert np.percentile(np.abs(error), 95) < 1e-3 + 3 * (0.033 / distance_m) ** 2
    np.testing.assert_allclose(found_std[INSIDE], 0.1 * distance_m, rtol=0.05)
    assert np.abs(joined_share(LAYOUT, 50.0)).max() == 0.5  # however near to a pole
