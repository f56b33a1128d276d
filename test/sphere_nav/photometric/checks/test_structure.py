from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, FrameMotion, Pinhole
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.structure import Aspect, find_rig_structure
from sphere_nav.photometric.checks.support import NO_SUPPORT
from worlds.room import BESIDE, structure_of, views_of

PARAMS = RegistrationParams(max_pixels=10_000)
CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def views(room):
    return views_of(room, PARAMS)


def test_gradients_of_another_place_do_not_agree(room, views):
    elsewhere = SE3.exp([1.0, 0.5, -0.5, 0.3, 2.0, 0.1])
    pyramid = build_pyramid(room.photograph(CAMERA, elsewhere, 1), CAMERA, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, replace(PARAMS, max_mad=1e3))
    assert structure_of(pyramid, views, alignment, PARAMS).agreement < 0.2


def test_the_gradients_of_a_rolling_shutter_agree_when_its_motion_is_known(room, views):
    twist = np.array([0.02, 0.0, 0.03, 0.0, 0.02, 0.0])
    image = np.rint(room.render_rolling(CAMERA, BESIDE, twist)).astype(np.uint8)
    motion = FrameMotion(BESIDE @ SE3.exp(-twist), 1.0)
    pyramid = build_pyramid(image, CAMERA, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, PARAMS, motion)
    found = structure_of(pyramid, views, alignment, PARAMS, motion)
    assert found.agreement > structure_of(pyramid, views, alignment, PARAMS).agreement


def test_how_likely_a_place_is_is_asked_of_a_good_alignment_too_and_moves_no_pose(room, views):
    pyramid = build_pyramid(room.photograph(CAMERA, BESIDE, 1), CAMERA, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, PARAMS)
    seen = [RigImage(pyramid, views=tuple(views))]
    place, fit = (find_rig_structure(seen, alignment, PARAMS, aspects=one) for one in (Aspect.PLACE, Aspect.FIT))
    assert place.chance < 1e-7 < fit.chance == 1.0
    assert place.support is fit.support is NO_SUPPORT
    wrong = replace(alignment, T_world_camera=BESIDE @ SE3.exp([0.5, 0.2, 0.0, 0.0, 0.3, 0.0]))
    assert find_rig_structure(seen, wrong, PARAMS, aspects=Aspect.PLACE).chance > 0.01
