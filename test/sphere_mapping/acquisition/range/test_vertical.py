"""Range between two levels; the whole way is tested in stitching/test_stitcher.py."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.matching import Disparity
from sphere_mapping.acquisition.range.vertical import VerticalStereo, withhold_edges
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_nav.params import build
from worlds.rig import RADIUS, WIDTH, seen, vertical_rig


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
    [(range_m, std_m)] = found.measured
    measured = np.isfinite(range_m)
    assert measured.mean() > 0.5
    assert np.isfinite(std_m[measured]).all()
    assert np.median(range_m[measured]) == pytest.approx(RADIUS, rel=0.05)
    assert found.bottom.shape == range_m.shape


def test_without_a_bottom_camera_nothing_is_measured(stereo, grays):
    found = stereo.find({name: image for name, image in grays.items() if name.startswith("top")})
    assert (found.measured, found.planes, found.bottom) == ([], None, None)


def test_a_thin_thing_that_the_other_level_shows_elsewhere_is_withheld_and_jumps_deviate_more():
    rng = np.random.default_rng(4)
    texture = 120 + 60 * cv2.GaussianBlur(rng.normal(0, 2, (256, 512)), (0, 0), 1.5)
    texture[180:244, 420:500] = 120 + 3 * (texture[180:244, 420:500] - 120)
    top, bottom = (np.clip(np.roll(texture, -k, axis=0) + rng.normal(0, 1, texture.shape), 1, 255) for k in (0, 3))
    top[80:84, 256:] += 70  # only above
    value, std = np.full(top.shape, 3.0, np.float32), np.full(top.shape, 0.1, np.float32)
    value[160:, :160] = 5.0  # as if there were a step
    value[184:236, 424:496] += 0.4  # misaligned, but no more than everywhere is allowed
    value[100:140, 300:400] = np.nan
    found = Disparity(value, std)
    withhold_edges(found, top.clip(1, 255).astype(np.uint8), bottom.astype(np.uint8), 2.5)
    assert np.isnan(found.value[80:84, 260:508]).mean() > 0.95
    assert np.isnan(found.value[176:240, 8:140]).mean() > 0.8
    assert np.isfinite(found.value[190:230, 430:490]).mean() > 0.9
    for beside in (slice(296, 300), slice(400, 404)):  # what is unknown is no difference
        assert np.isfinite(found.value[104:136, beside]).all()
    assert np.isfinite(found.value[16:70, 4:508]).mean() > 0.99
    assert np.isfinite(found.value[176:240, 180:410]).mean() > 0.99
    np.testing.assert_allclose(found.std[16:70, 4:508][np.isfinite(found.std[16:70, 4:508])], 0.1)
    beside = found.std[154, 4:140]
    assert np.isfinite(beside).any()
    np.testing.assert_allclose(beside[np.isfinite(beside)], np.hypot(0.1, 0.1 * 2.0), rtol=1e-5)
