"""A camera that turns while it is read is found as well as one that stands still."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, FrameMotion, Pinhole, Spherical
from sphere_nav.photometric import View, build_pyramid, prepare_reference, register
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA = Pinhole(320, 240, 262.0, 262.0, 159.5, 119.5)
SPHERE = Spherical(1024, 512)
READOUT = 0.68  # of the time between two frames
FRAME_TURN = np.radians(1.2)


@pytest.fixture(scope="module")
def view(room):
    image, range_m = room.render(SPHERE, SE3.identity())
    return View(prepare_reference(image, range_m, SPHERE), SE3.identity())


def test_the_error_is_that_of_a_global_shutter(room, view):
    rng = np.random.default_rng(0)
    axis, direction = rng.normal(size=(2, 3))
    moved = np.concatenate([0.02 * direction, FRAME_TURN * axis / np.linalg.norm(axis)])
    truth = SE3.exp(0.1 * rng.normal(size=6)) @ T_BODY_OPTICAL
    motion = FrameMotion(truth @ SE3.exp(-moved), READOUT)
    start = truth @ SE3.exp(0.3 * moved)
    images = (room.render(CAMERA, truth)[0], room.render_rolling(CAMERA, truth, READOUT * moved))
    still, rolling = (build_pyramid(image, CAMERA) for image in images)
    found = [register(still, [view], start)]
    found += [register(rolling, [view], start, motion=one) for one in (motion, None)]
    errors = np.array([result.T_world_camera.distance(truth) for result in found])
    assert (errors[1] < 1.3 * errors[0] + (2e-4, 5e-5)).all()  # and what float32 and resampling leave
    assert (errors[2] > 4.0 * errors[1]).all()  # what it costs not to know
