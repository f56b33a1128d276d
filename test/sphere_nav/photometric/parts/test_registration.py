"""Images of another day aligned by their parts: where grey levels lead away, and a wrong place has no support."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.parts.registration import register_parts
from worlds.parked import ParkingRoom, boxes_along
from worlds.room import optical

PARAMS = RegistrationParams(max_pixels=20_000)
SPHERE, CAMERA = Spherical(768, 384), Pinhole(240, 180, 165.0, 165.0, 119.5, 89.5)
TRUTH = optical(SE3.from_planar(-1.7, 0.1, 0.05))
FAR = TRUTH @ SE3.exp([0.15, 0.05, -0.25, 0.02, 0.06, -0.03])  # where the camera is thought to be


def room(seed, places):
    return ParkingRoom((8.0, 3.0, 1.5), (1.0, 40.0, 40), gain=30.0, boxes=boxes_along(seed, places, height=1.8))


@pytest.fixture(scope="module")
def view():
    T = SE3.from_planar(-2.0, 0.0, 0.0)
    return View(prepare_reference(*room(1, (0.0, 2.0, 4.0)).render(SPHERE, T), SPHERE, PARAMS), T)


@pytest.fixture(scope="module")
def night():
    """Another day: other boxes, a light that falls off to one side, a part of the view of inverted contrast."""
    gray = room(7, (-0.7, 1.2, 3.2)).photograph(CAMERA, TRUTH, 1).astype(np.float32)
    gray *= np.linspace(0.25, 1.0, CAMERA.width)[None, :]
    gray[:, 90:125] = gray[:, 90:125].max() - gray[:, 90:125]
    return build_pyramid(np.clip(gray, 1, 255).astype(np.uint8), CAMERA, PARAMS.pyramid)


def off(pose):
    return pose.distance(TRUTH)


def test_another_day_is_aligned_by_its_parts_where_grey_levels_lead_away(night, view):
    by_levels = register(night, [view], FAR, PARAMS)
    assert off(by_levels.T_world_camera)[0] > 0.1
    found = register_parts([RigImage(night, views=(view,))], FAR, PARAMS)
    assert found.chance < 1e-7
    assert off(found.T_world_body)[0] < 0.02
    assert off(found.T_world_body)[1] < 0.005
    xi = (found.T_world_body.inverse() @ TRUTH).log()
    assert xi @ np.linalg.solve(found.covariance, xi) < 22.5  # chi^2 of 6 at 0.001


def test_a_camera_on_a_body_gives_the_pose_of_the_body(night, view):
    mount = SE3.exp([0.4, -0.2, 0.1, 0.3, -0.1, 0.7])
    found = register_parts([RigImage(night, mount, (view,))], FAR @ mount.inverse(), PARAMS)
    assert off(found.T_world_body @ mount)[0] < 0.02
