from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, FrameMotion, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.structure import find_rig_structure

PARAMS = RegistrationParams(max_pixels=10_000)
SPHERE = Spherical(512, 256)
CAMERAS = [Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5), Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, 0, 0, 0))]
SOMEWHERE = SE3.exp([0.1, -0.05, 0.2, 0.02, 0.3, 0.01])


def structure_of(pyramid, views, *rest):
    """Check the images of one camera."""
    return find_rig_structure([RigImage(pyramid, views=tuple(views))], *rest)


@pytest.fixture(scope="module")
def views(room):
    places = [SE3.identity(), SE3.exp([0.3, 0.0, 0.1, 0.0, 0.0, 0.0])]
    return [View(prepare_reference(*room.render(SPHERE, T), SPHERE, PARAMS), T) for T in places]


def seen(room, views, lens, camera, truth=SOMEWHERE, seed=1):
    """An image made with `lens`, aligned as if it were of `camera`."""
    pyramid = build_pyramid(room.photograph(lens, truth, seed), camera, PARAMS.pyramid)
    alignment = register(pyramid, views, truth, PARAMS)
    assert alignment.is_converged
    return structure_of(pyramid, views, alignment, PARAMS)


def test_gradients_of_another_place_do_not_agree(room, views):
    camera = CAMERAS[0]
    elsewhere = SE3.exp([1.0, 0.5, -0.5, 0.3, 2.0, 0.1])
    pyramid = build_pyramid(room.photograph(camera, elsewhere, 1), camera, PARAMS.pyramid)
    alignment = register(pyramid, views, SOMEWHERE, replace(PARAMS, max_mad=1e3))
    assert structure_of(pyramid, views, alignment, PARAMS).agreement < 0.2


def test_the_gradients_of_a_rolling_shutter_agree_when_its_motion_is_known(room, views):
    camera, twist = CAMERAS[0], np.array([0.02, 0.0, 0.03, 0.0, 0.02, 0.0])
    image = np.rint(room.render_rolling(camera, SOMEWHERE, twist)).astype(np.uint8)
    motion = FrameMotion(SOMEWHERE @ SE3.exp(-twist), 1.0)
    pyramid = build_pyramid(image, camera, PARAMS.pyramid)
    alignment = register(pyramid, views, SOMEWHERE, PARAMS, motion)
    found = structure_of(pyramid, views, alignment, PARAMS, motion)
    assert found.agreement > structure_of(pyramid, views, alignment, PARAMS).agreement
