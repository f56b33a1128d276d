import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.stereo import (
    depth_from_stereo,
    disparities_of_depths,
    match_pair,
    sphere_from_stereo,
)
from sphere_mapping.params import StereoParams
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from worlds.room import optical, sharp_room

CAMERA = Pinhole(400, 260, 300.0, 300.0, 200.0, 130.0)
BASELINE = 0.3
ROOM = sharp_room((6, 4, 3), shortest=0.1)
AT = SE3.exp([0.3, -0.2, 0.1, 0.05, -0.1, 0.4])
NOISE = 2.0
SEARCH = disparities_of_depths(CAMERA, BASELINE, StereoParams())


@pytest.fixture(scope="module")
def pair():
    """Left and right image with noise, and the true disparity of the left pixels."""
    rng = np.random.default_rng(0)

    def noisy(T_room_camera):
        image, depth_m = ROOM.rgbd(CAMERA, T_room_camera)
        return np.clip(image + rng.normal(0, NOISE, image.shape), 1, 255).astype(np.uint8), depth_m

    left, depth_m = noisy(optical(AT))
    right, _ = noisy(optical(AT) @ SE3.from_parts(np.eye(3), [BASELINE, 0, 0]))
    return left, right, CAMERA.fx * BASELINE / depth_m


def test_disparity_is_dense_and_without_bias(pair):
    left, right, truth = pair
    found = match_pair(left, right, SEARCH, StereoParams())
    error = (found.value - truth)[np.isfinite(found.value)]
    assert np.isfinite(found.value).mean() > 0.85  # the left margin is outside of the right image
    assert abs(np.median(error)) < 0.02  # of a pixel
    assert np.median(np.abs(error)) < 0.15


def test_the_deviation_is_of_the_size_of_the_error(pair):
    left, right, truth = pair
    found = match_pair(left, right, SEARCH, StereoParams(noise=NOISE, calibration_px=0.0))
    ratio = np.abs(found.value - truth) / found.std
    # 0.67 if the model were perfect; interpolation and slant add to the noise
    assert 0.4 < np.nanmedian(ratio) < 2.5


def test_the_sphere_has_the_range_of_the_room(pair):
    left, right, _ = pair
    sphere = sphere_from_stereo(left, right, CAMERA, BASELINE, stamp_ns=9)
    rays = sphere.camera.unproject(pixel_grid(sphere.camera)) @ AT.rotation.T
    _, range_m = ROOM.cast(AT.translation, rays)
    error = np.abs(sphere.range_m / range_m - 1)[sphere.measured]
    assert sphere.stamp_ns == 9
    # 0.56: the window shows 0.79, 0.93 of these have a disparity; of a fourth of them, walls 6 m away, the deviation of
    # 0.15 px that rectification may leave, and as much again on slanted lines, is above 1.5 % of the range
    assert 0.54 < sphere.measured.mean() < 0.6
    assert np.median(error) < 0.01
    assert np.isfinite(sphere.range_std_m[sphere.measured]).all()


def test_far_things_are_not_measured_but_uncertain_ones_neither(pair):
    left, right, _ = pair
    # the least deviation is what rectification may leave: 0.15 px of the 18 px that the nearest wall has, 0.9 %
    depth_m, relative_std = depth_from_stereo(left, right, CAMERA, BASELINE, StereoParams(max_relative_std=0.012))
    assert np.nanmax(relative_std[np.isfinite(depth_m)]) <= 0.012
    same, _ = depth_from_stereo(left, left, CAMERA, BASELINE, StereoParams())
    assert np.isnan(same).mean() > 0.99  # disparity 0


def test_what_is_no_rectified_pair_is_refused(pair):
    left, right, _ = pair
    for arguments, message in (
        ((left, right, CAMERA, np.nan), "baseline: expected positive metres, found nan"),
        ((left, right[:100], CAMERA, BASELINE), "right image: expected 400 x 260"),
    ):
        with pytest.raises(ValueError, match=message):
            depth_from_stereo(*arguments, StereoParams())
