"""Rotation between images from the coarsest level (M15 eq. 20)."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, RegistrationParams, build_pyramid, register_rotation
from sphere_nav.photometric.align.rotation import correlation_after_turn

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24))
T_ROOM_CAMERA = SE3.from_parts([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])


def test_a_turn_of_five_degrees_is_found(room):
    turn = SE3.exp([0, 0, 0, 0.01, np.deg2rad(5), -0.01])
    before = build_pyramid(room.render(CAMERA, T_ROOM_CAMERA)[0], CAMERA, PARAMS.pyramid)
    now = build_pyramid(room.render(CAMERA, T_ROOM_CAMERA @ turn)[0], CAMERA, PARAMS.pyramid)
    found = register_rotation(now, before, PARAMS)
    assert found.distance(turn)[1] < np.deg2rad(0.3)
    assert np.array_equal(found.translation, np.zeros(3))


def test_even_images_give_no_rotation():
    even = build_pyramid(np.full((120, 160), 90, np.uint8), CAMERA, PARAMS.pyramid)
    assert np.array_equal(register_rotation(even, even, PARAMS).matrix, np.eye(4))


def test_images_correlate_after_the_turn_between_them(room):
    for camera in [CAMERA, Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, 0, 0, 0)), Spherical(256, 128)]:
        turn = SE3.exp([0, 0, 0, 0.01, np.deg2rad(8), -0.01])
        before, now = (
            build_pyramid(room.render(camera, pose)[0], camera, PARAMS.pyramid).levels[-1]
            for pose in (T_ROOM_CAMERA, T_ROOM_CAMERA @ turn)
        )
        right = correlation_after_turn(now, before, turn.rotation)
        assert right > 0.97
        assert correlation_after_turn(now, before, np.eye(3)) < 1.0 - 5.0 * (1.0 - right)
        assert correlation_after_turn(before, before, np.eye(3)) == pytest.approx(1.0, abs=1e-5)


def test_images_that_share_little_or_show_nothing_do_not_correlate(room):
    image = room.render(CAMERA, T_ROOM_CAMERA)[0]
    level = build_pyramid(image, CAMERA, PARAMS.pyramid).levels[-1]
    even = build_pyramid(np.full(image.shape, 90, np.uint8), CAMERA, PARAMS.pyramid).levels[-1]
    assert correlation_after_turn(level, level, SE3.exp([0, 0, 0, 0, np.deg2rad(90), 0]).rotation) is None
    assert correlation_after_turn(level, even, np.eye(3)) is None
