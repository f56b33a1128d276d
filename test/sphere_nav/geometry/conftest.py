"""Random rotations, motions and cameras that the laws are tested on; all seeded."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Omni, Pinhole, Spherical

NORMS = {
    "ordinary": (0.1, 3.0),
    "tiny": (0.0, 1e-7),
    "seam of the series": (0.9e-4, 1.1e-4),
    "near pi": (np.pi - 1e-6, np.pi - 1e-9),
}
CAMERAS = {
    "pinhole": Pinhole(640, 480, 525.0, 520.0, 319.5, 239.0),
    "rational": Pinhole(1280, 960, 600.0, 605.0, 640.2, 470.1, (0.3, -0.05, 2e-4, 1e-4, 0.01, 0.6, -0.02, 0.02)),
    "fisheye": Fisheye(1280, 1024, 330.0, 329.0, 640.0, 510.0, (0.02, -0.005, 0.001, -0.0002)),
    "double sphere": DoubleSphere(1216, 1216, 225.0, 222.6, 610.8, 612.7, -0.28, 0.57),
    "omni, long": Omni(1280, 1024, 1100.0, 1102.0, 640.0, 511.0, 1.9, (-0.2, 0.3, 1e-3, -5e-4)),
    "sphere": Spherical(512, 256),
    "window over the seam": Spherical(200, 100, 512.0, 420.0, 80.0),  # columns 420 ... 511 and 0 ... 107
}


@pytest.fixture(params=[(), (2, 3)], ids=str)
def shape(request):
    return request.param


@pytest.fixture(params=NORMS)
def rotation_vector(request, shape):
    """Rotation vectors (*shape, 3) of ordinary, tiny and almost-pi norm."""
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(*shape, 3))
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True) * rng.uniform(*NORMS[request.param], size=(*shape, 1))


@pytest.fixture
def tangent(rotation_vector):
    """Tangent vectors (*shape, 6) as (v, omega)."""
    v = np.random.default_rng(2).normal(size=rotation_vector.shape)
    return np.concatenate([v, rotation_vector], axis=-1)


@pytest.fixture
def motions(shape):
    """Three batches of ordinary motions, a to b to c."""
    rng = np.random.default_rng(3)
    return [SE3.exp(rng.normal(size=(*shape, 6))) for _ in range(3)]


@pytest.fixture(params=CAMERAS)
def camera(request):
    return CAMERAS[request.param]


@pytest.fixture
def pixels(camera):
    """Sub-pixel positions (400, 2) over the whole image area that have a ray."""
    rng = np.random.default_rng(4)
    found = rng.uniform((-0.499, -0.499), (camera.width - 0.501, camera.height - 0.501), size=(400, 2))
    found = found[np.isfinite(camera.unproject(found)).all(axis=-1)]
    assert len(found) > 250  # the all-direction fisheye has no rays in its corners
    return found


@pytest.fixture
def visible_points(camera, pixels):
    """Points (N, 3), 0.3 m to 50 m away, that the camera sees."""
    return camera.unproject(pixels) * np.random.default_rng(5).uniform(0.3, 50.0, size=(len(pixels), 1))
