"""Pixels of an alignment, warped into the image: where they are, and how their residuals change with the pose."""

from dataclasses import replace

import numpy as np

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import RegistrationParams, View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.pixels.samples import sample_views

NUM_SAMPLES = 2048  # written out: imported, a change would go unseen

PARAMS, CAMERA = RegistrationParams(max_pixels=10_000), Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
POSE = SE3.exp([0.1, -0.05, 0.2, 0.02, 0.3, 0.01])


def sampled(image, alignment):
    (light,) = zip(alignment.gains, alignment.biases, strict=True)
    return sample_views(image, alignment.T_world_camera, np.array([light]), PARAMS, None)


def test_samples_are_in_the_image_and_change_with_the_pose_as_they_say(room):
    sphere = Spherical(512, 256)
    views = [View(prepare_reference(*room.render(sphere, SE3.identity()), sphere, PARAMS), SE3.identity())]
    pyramid = build_pyramid(room.photograph(CAMERA, POSE, noise=0.0), CAMERA, PARAMS.pyramid)
    image, found = RigImage(pyramid, views=tuple(views)), register(pyramid, views, POSE, PARAMS)
    one = sampled(image, found)
    assert 0.3 * NUM_SAMPLES < len(one.residual) <= 1.5 * NUM_SAMPLES
    assert np.median(np.abs(one.residual)) < 2.0
    uv, _ = CAMERA.project(one.points)
    np.testing.assert_allclose(one.at, uv / [79.5, 59.5] - 1.0, atol=1e-6)
    for axis in range(6):
        xi = 2e-4 * np.eye(6)[axis]
        there = replace(found, T_world_camera=found.T_world_camera @ SE3.exp(xi))
        other = sampled(image, there)
        assert len(other.residual) >= len(one.residual) - 20
        if len(other.residual) == len(one.residual):
            change, expected = other.residual - one.residual, one.by_pose @ xi
            assert np.median(np.abs(change - expected)) < 0.1 * np.median(np.abs(expected)) + 2e-3


def test_a_view_that_the_camera_does_not_see_has_no_samples(room):
    behind = POSE @ SE3.exp([0.0, 0.0, 0.0, 0.0, np.pi, 0.0])
    views = [View(prepare_reference(*room.render(CAMERA, behind), CAMERA, PARAMS), behind)]
    pyramid = build_pyramid(room.photograph(CAMERA, POSE, noise=0.0), CAMERA, PARAMS.pyramid)
    image, found = RigImage(pyramid, views=tuple(views)), register(pyramid, views, POSE, PARAMS)
    assert found.reason
    one = sampled(image, found)
    assert one.points.shape == (0, 3)
    assert one.at.shape == (0, 2)
