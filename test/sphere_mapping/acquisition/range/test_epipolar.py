"""Range of two levels whose cameras stand beside the axis, in images joined for one distance: exact geometry."""

from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.epipolar import correct_baseline, joined_share, to_common_center
from sphere_mapping.acquisition.range.planes import Viewpoints, _extend, _fit
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


@pytest.mark.parametrize("distance_m", [1.5, 3.0, 5.0, 20.0])
def test_range_from_the_center_is_that_of_the_scene_wherever_the_images_were_joined(distance_m):
    range_m = matched_range(shown(distance_m)).astype(np.float32)
    std_m, shrink = 0.1 * range_m, 1.0 / (1.0 + joined_share(LAYOUT, 1.0 / JOINED_M))
    correct_baseline(range_m, std_m, np.zeros_like(range_m), shrink, 1.0 / JOINED_M)
    found, found_std = to_common_center(range_m, std_m, LAYOUT, 1.0 / JOINED_M)
    error = (found / distance_m - 1.0)[INSIDE]
    assert abs(np.median(error)) < 1e-4 + 0.5 * (0.033 / distance_m) ** 2
    assert np.percentile(np.abs(error), 95) < 1e-3 + 3 * (0.033 / distance_m) ** 2
    np.testing.assert_allclose(found_std[INSIDE], 0.1 * distance_m, rtol=0.05)


def test_images_joined_for_very_far_are_turned_by_nothing():
    np.testing.assert_array_equal(joined_share(LAYOUT, 0.0), np.zeros(OWNER.shape))


def test_the_range_of_a_plane_is_that_of_the_plane_from_the_center():
    normal = np.array([0.3, 0.1, 0.2])  # normal . point = 1: 2.7 m away
    unknown, zero = np.full(OWNER.shape, np.nan, np.float32), np.zeros(OWNER.shape, np.float32)
    found, shrink = (unknown.copy(), unknown.copy()), 1.0 / (1.0 + joined_share(LAYOUT, 1.0 / JOINED_M))
    viewpoints = Viewpoints(BASELINE_M, OWNER, OFFSETS, zero, shrink, 1.0 / JOINED_M)
    labels, planes = np.ones(OWNER.shape, np.int32), {1: (normal, 1e-10 * np.eye(3))}
    _extend(planes, labels, 0, viewpoints, (unknown, unknown), MatchParams(), found)
    range_m, _ = to_common_center(*found, LAYOUT, 1.0 / JOINED_M)
    truth = 1.0 / np.maximum(RAYS @ normal, 1e-6)
    is_near = INSIDE & (truth < 6.0) & ~np.isnan(range_m)
    assert is_near.sum() > 5000
    error = range_m[is_near] / truth[is_near] - 1.0
    assert abs(np.median(error)) < 6e-4
    assert np.percentile(np.abs(error), 90) < 0.01


def test_a_plane_is_fitted_to_what_cameras_beside_the_center_measure():
    rng = np.random.default_rng(3)
    rays, centers = rng.normal(size=(60, 3)), np.float64(OFFSETS)[rng.integers(0, 2, 60)] * 3
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    per_m, range_m = 1.0 / JOINED_M, rng.uniform(1.0, 9.0, 60)
    normal = np.array([0.3, 0.1, 0.2])
    for _ in range(50):  # until the points, as `Viewpoints` has them, are on the plane
        along = np.sum(rays * centers, axis=1)
        points = centers * (1.0 - range_m * per_m)[:, None] + (range_m * (1.0 + along * per_m))[:, None] * rays
        rays += 0.5 * ((1.0 - points @ normal) / (normal @ normal) / range_m)[:, None] * normal
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    on_plane = np.abs(points @ normal - 1.0) < 1e-6
    assert on_plane.sum() > 20
    found = _fit(rays[on_plane], centers[on_plane], 1.0 / range_m[on_plane], np.full(on_plane.sum(), 1e-3), per_m)
    assert found is not None
    np.testing.assert_allclose(found[0], normal, atol=1e-5)
