"""A camera as a vector is the same camera, and what each number does to its pixels is right."""

import numpy as np
import pytest

from sphere_nav.geometry import Fisheye, OCam, Omni, Pinhole, Spherical
from sphere_nav.geometry.cameras.lens import J_lens, camera_of, lens_of

CAMERAS = (
    Pinhole(640, 480, 400.0, 402.0, 318.0, 243.0, (-0.2, 0.05, 1e-3, -5e-4, -0.01)),
    Fisheye(640, 480, 250.0, 251.0, 321.0, 238.0, (0.03, -0.012, 0.004, -0.0006)),
    Omni(640, 480, 500.0, 501.0, 321.0, 238.0, 1.3, (-0.12, 0.06, 2e-3, -3e-3)),
    OCam(640, 480, 321.0, 238.0, (230.0, 0.0, -1.3e-3, 1.1e-6, -3e-9), 1.002, 4e-3),
)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.model)
def test_a_lens_is_the_camera_and_has_the_derivatives_that_it_says(camera, rng):
    lens, points = lens_of(camera), rng.uniform([-0.5, -0.5, 0.6], [0.5, 0.5, 1.5], (20, 3))
    assert camera_of(camera.model, (640, 480), lens, 5) == camera
    J = J_lens(camera, points)
    for k, size in enumerate([1e-2] * 4 + [1e-4] * 8):
        step = size * np.eye(12)[k]
        after, before = (
            camera_of(camera.model, (640, 480), one, 5).project(points)[0] for one in (lens + step, lens - step)
        )
        np.testing.assert_allclose(J[:, :, k], (after - before) / (2 * size), atol=2e-3)  # of up to 1000


def test_a_sphere_is_no_lens():
    with pytest.raises(ValueError, match="model: expected one of pinhole, fisheye, omni, ocam"):
        lens_of(Spherical(64, 32))
