"""Images of another day aligned by their parts: where grey levels lead away, and a wrong place has no support."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.parts.registration import register_parts
from worlds.parked import CAMERA, SPHERE, TRUTH, other_day, parked
from worlds.room import views_of

PARAMS = RegistrationParams(max_pixels=20_000)
FAR = TRUTH @ SE3.exp([0.15, 0.05, -0.25, 0.02, 0.06, -0.03])  # where the camera is thought to be


@pytest.fixture(scope="module")
def view():
    return views_of(parked(), PARAMS, SPHERE, [SE3.from_planar(-2.0, 0.0, 0.0)])[0]


@pytest.fixture(scope="module")
def night():
    """Another day: other boxes, a light that falls off to one side, a part of the view of inverted contrast."""
    gray = other_day().photograph(CAMERA, TRUTH, 1).astype(np.float32)
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
