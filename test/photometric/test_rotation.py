"""Rotation between images from the coarsest level (M15 eq. 20)."""

import numpy as np

from photometric import PyramidParams, RegistrationParams, build_pyramid, register_rotation
from sphere_geometry import SE3, Pinhole

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
