"""Light that varies over the view: that it is there, and by how much it biases a pose."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.alignment import Alignment
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.structure import find_rig_structure
from worlds.room import Room

PARAMS = RegistrationParams(max_pixels=10_000, max_mad=100.0)
SPHERE, CAMERA = Spherical(512, 256), Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
POSES = [SE3.exp([0.1, -0.05, 0.2, 0.02, 0.3, 0.01]), SE3.exp([-0.2, 0.1, 0.0, 0.0, -0.5, 0.0])]


@pytest.fixture(scope="module")
def soft():
    """A room without fine texture."""
    return Room((4.0, 3.0, 2.0), (1.0, 14.0, 30), gain=30.0, seed=21)


@pytest.fixture(scope="module")
def views(soft):
    places = [SE3.identity(), SE3.exp([0.3, 0.0, 0.1, 0.0, 0.0, 0.0])]
    return [View(prepare_reference(*soft.render(SPHERE, T), SPHERE, PARAMS), T) for T in places]


def shine(image, slope):
    """Return an image in light that falls from one side to the other."""
    ramp = np.exp(np.linspace(-slope, slope, image.shape[1]))
    return np.clip(np.rint(image * ramp), 1, 255).astype(np.uint8)


def structure_of(pyramid, views, *rest):
    """Check the images of one camera."""
    return find_rig_structure([RigImage(pyramid, views=tuple(views))], *rest)


def aligned(soft, views, pose, seed=1, slope=0.0):
    pyramid = build_pyramid(shine(soft.photograph(CAMERA, pose, seed), slope), CAMERA, PARAMS.pyramid)
    return pyramid, register(pyramid, views, pose, PARAMS)


@pytest.mark.parametrize("pose", POSES)
def test_even_light_is_seen_to_be_even(soft, views, pose):
    for seed in range(4):
        pyramid, found = aligned(soft, views, pose, seed)
        bias = structure_of(pyramid, views, found, PARAMS).illumination
        assert bias.share < 0.05
        assert np.linalg.norm(bias.xi[:3]) < 0.002


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("slope", [-0.2, 0.2, -0.4])
def test_what_uneven_light_pulls_is_found(soft, views, pose, slope):
    pyramid, found = aligned(soft, views, pose, slope=slope)
    off = (found.T_world_camera.inverse() @ pose).log()
    bias = structure_of(pyramid, views, found, PARAMS).illumination
    assert np.linalg.norm(off[:3]) > 0.02  # or there is nothing to find
    assert bias.share > 0.3
    # half of it and more, the right way: what pulls by decimetres is at home in the coarse levels, this is the finest
    assert 0.4 < bias.xi @ off / (off @ off) < 1.2
    assert bias.xi @ off > 0.8 * np.linalg.norm(bias.xi) * np.linalg.norm(off)


def test_the_pull_of_cameras_on_a_body_is_that_of_the_body(soft, views):
    place = SE3.exp([0.2, -0.1, 0.3, 0.1, 0.4, -0.2])
    pyramid, found = aligned(soft, views, POSES[0], slope=0.4)
    # twice: on the way pixels may be chosen anew, and stay chosen for the next call
    _, alone = (structure_of(pyramid, views, found, PARAMS).illumination for _ in range(2))
    image = RigImage(pyramid, place, tuple(views))
    body = Alignment(**{**vars(found), "T_world_camera": found.T_world_camera @ place.inverse()})
    there = find_rig_structure([image], body, PARAMS).illumination
    assert there.share == pytest.approx(alone.share, abs=1e-3)
    np.testing.assert_allclose(there.xi, place.adjoint() @ alone.xi, atol=2e-4)
