from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.lens import mean_share
from sphere_nav.photometric.checks.structure import Aspect, find_rig_structure

PARAMS = RegistrationParams(max_pixels=10_000)
SPHERE = Spherical(512, 256)
PINHOLE = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5, (0.0, 0.0))
CAMERAS = [PINHOLE, Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, 0, 0, 0))]
SOMEWHERE = SE3.exp([0.1, -0.05, 0.2, 0.02, 0.3, 0.01])


@pytest.fixture(scope="module")
def views(room):
    places = [SE3.identity(), SE3.exp([0.3, 0.0, 0.1, 0.0, 0.0, 0.0])]
    return [View(prepare_reference(*room.render(SPHERE, T), SPHERE, PARAMS), T) for T in places]


def told(room, views, lens, camera, seed=1):
    """What an image made with `lens` tells, aligned as if it were of `camera`; with the aligned pose."""
    image = RigImage(build_pyramid(room.photograph(lens, SOMEWHERE, seed), camera, PARAMS.pyramid), views=tuple(views))
    alignment = register(image.pyramid, image.views, SOMEWHERE, PARAMS)
    (found,) = find_rig_structure([image], alignment, PARAMS, aspects=Aspect.FIT).lenses
    return found, alignment.T_world_camera


def scaled(camera, share):
    return replace(camera, fx=(1 + share) * camera.fx, fy=(1 + share) * camera.fy)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.model)
def test_a_right_lens_has_no_error(room, views, camera):
    found = [told(room, views, camera, camera, seed)[0] for seed in range(4)]
    assert max(mean_share(one.share) for one in found) < 0.008  # of 160 pixels
    sigmas = [one.share / np.sqrt(np.diag(one.covariance)) for one in found]
    assert np.abs(sigmas).max() < 5.0  # 24 pieces a view and 12 unknowns: a little wider than a normal distribution


@pytest.mark.parametrize("share", [-0.05, 0.02])
@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.model)
def test_another_focal_length_is_found_with_what_it_does_to_the_pose(room, views, camera, share):
    found, pose = told(room, views, scaled(camera, share), camera)
    assert found.share @ [1.0, 1.0 / 3.0] == pytest.approx(share, abs=0.2 * abs(share))
    left = (pose.inverse() @ SOMEWHERE).log()
    assert np.linalg.norm((left - found.by_share @ found.share)[:3]) < 0.5 * np.linalg.norm(left[:3])


def test_another_distortion_is_told_from_another_focal_length(room, views):
    found, _ = told(room, views, replace(PINHOLE, distortion=(-0.06, 0.0)), PINHOLE)
    assert found.share[1] == pytest.approx(-0.06 * (80.0**2 + 60.0**2) / 110.0**2, rel=0.35)  # at the corner
    assert abs(found.share[0]) < 0.01
