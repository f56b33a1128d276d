"""Range of two levels whose cameras stand beside the axis, in images joined for one distance: exact geometry."""

import numpy as np
import pytest

from sphere_mapping.acquisition.params import MatchParams, StitchParams
from sphere_mapping.acquisition.range.matching import Disparity
from sphere_mapping.acquisition.range.vertical import VerticalStereo, in_own_directions, range_from_disparity
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build
from worlds.rig import RADIUS, WIDTH, seen, vertical_rig

WHOLE = Spherical(256, 128)
BASELINE_M, JOINED_M = 0.3, 5.0
PER_ROW = np.pi / WHOLE.height
OFFSETS = np.float32([[0.03, 0.01, 0.005], [-0.03, 0.012, 0.0]])
LOW_OFFSETS = np.float32([[0.02, 0.0, -0.01], [-0.025, 0.01, 0.004]])
OWNER = np.repeat((np.arange(256) >= 128).astype(np.int8)[None], 128, axis=0)
SHOWN = (OWNER, OFFSETS), (OWNER, LOW_OFFSETS)
RAYS = pixel_rays(WHOLE)
INSIDE = np.abs(RAYS[..., 2]) < 0.8
SIGMA_PX = 0.02


def shown(distance_m):
    """Return the points (H, W, 3) of a sphere around the centre that the pixels of the upper level show."""
    offset = OFFSETS[OWNER].astype(float)
    ray = JOINED_M * RAYS - offset
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = np.sum(ray * offset, axis=-1)
    reach = -along + np.sqrt(along**2 + distance_m**2 - np.sum(offset**2, axis=-1))
    return offset + reach[..., None] * ray


def disparity_of(points):
    """Return by how many rows points (H, W, 3) are higher in the lower sphere, joined for the same distance."""
    offset = LOW_OFFSETS[OWNER].astype(float)
    ray = points - offset + [0.0, 0.0, BASELINE_M]
    square, product = np.sum(ray**2, axis=-1), np.sum(ray * offset, axis=-1) / JOINED_M
    rest = np.sum(offset**2, axis=-1) / JOINED_M**2 - 1.0
    factor = (-product + np.sqrt(product**2 - square * rest)) / square
    pixel = offset / JOINED_M + factor[..., None] * ray  # of length 1: JOINED_M pixel - offset is along the ray
    above, below = (np.arccos(np.clip(direction[..., 2], -1.0, 1.0)) for direction in (RAYS, pixel))
    return ((above - below) / PER_ROW).astype(np.float32)


def range_of(disparity, sigma_px=SIGMA_PX):
    std = np.full(disparity.shape, sigma_px, np.float32)
    ranged = range_from_disparity(Disparity(disparity, std), BASELINE_M, MatchParams(), SHOWN, 1.0 / JOINED_M)
    return in_own_directions(*ranged, SHOWN[0], 1.0 / JOINED_M)


@pytest.mark.parametrize("distance_m", [1.5, 8.0])
def test_range_from_the_center_is_that_of_the_scene_wherever_the_images_were_joined(distance_m):
    disparity = disparity_of(shown(distance_m))
    found, std_m = range_of(disparity)
    error = (found / distance_m - 1.0)[INSIDE]
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmedian(np.abs(error)) < 1e-4 + 0.3 * (0.033 / distance_m) ** 2
    assert np.nanpercentile(np.abs(error), 95) < 1e-3 + 3 * (0.033 / distance_m) ** 2
    nearer, _ = range_of(disparity + np.float32(0.01))
    both = INSIDE & np.isfinite(found) & np.isfinite(nearer)
    np.testing.assert_allclose(
        std_m[both], (found[both] - nearer[both]) * SIGMA_PX / 0.01, rtol=0.25
    )  # far off the middle


def test_what_is_beyond_all_is_far_what_is_not_known_well_enough_is_nothing():
    far = disparity_of(shown(4000.0))
    assert np.isposinf(range_of(far, 1e-4)[0][INSIDE]).all()
    for unknown in (np.full_like(far, np.nan), far - np.float32(2.0)):
        assert np.isnan(range_of(unknown, np.nan)[0]).all()
    assert np.isnan(range_of(disparity_of(shown(1.5)), 1.0)[0][INSIDE]).all()
    assert not np.isfinite(range_of(disparity_of(shown(0.4)))[0][INSIDE]).any()


def test_a_pixel_takes_the_range_of_the_pixel_that_shows_its_point():
    range_m = np.full(OWNER.shape, 2.0, np.float32)
    range_m[:, 100:] = 4.0
    far_off = np.float32([[0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
    owner = OWNER.copy()
    owner[:, :4] = -1
    range_m[owner < 0], range_m[20, 40], range_m[30, 50] = np.nan, np.inf, np.nan
    found, std_m = in_own_directions(range_m, 0.1 * range_m, (owner, far_off), 0.0)
    # joined very far, a pixel shows what a camera 0.3 m ahead sees in its direction: of 4 m, 2 columns aside
    assert (found[64, 70:90] == 2.0).all()
    jump = int(np.flatnonzero(found[64, 80:120] == 4.0)[0]) + 80
    aside = np.arctan2(0.3 * np.sin((0.5 - 100.5 / 256) * 2 * np.pi), 4.0) / (2 * np.pi) * 256
    assert jump == pytest.approx(100 + aside, abs=0.6)
    np.testing.assert_allclose(std_m[64, 70:90], 0.2, rtol=1e-6)
    assert np.isnan(found[:, :4]).all()
    assert np.isposinf(found[20, 40])
    assert np.isnan(found[30, 50])


@pytest.fixture(scope="module")
def stereo():
    params = build(StitchParams, {"width": WIDTH})
    return VerticalStereo(Layouts(vertical_rig(), params, {}), params, jobs=1)


@pytest.fixture(scope="module")
def grays():
    return {part.name: seen(part) for part in vertical_rig().cameras}


def test_range_is_that_of_the_scene_and_the_order_is_checked_once(stereo, grays):
    assert not stereo.is_checked
    found = stereo.find(grays)
    assert stereo.is_checked
    [(range_m, std_m)] = found
    measured = np.isfinite(range_m)
    assert measured.mean() > 0.5
    assert np.isfinite(std_m[measured]).all()
    assert np.median(range_m[measured]) == pytest.approx(RADIUS, rel=0.05)
