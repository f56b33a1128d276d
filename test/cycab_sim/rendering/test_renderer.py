import numpy as np
import pytest

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer, _split
from cycab_sim.sensors.cameras import OPTICAL
from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid

PINHOLE = Pinhole(160, 120, 95.0, 95.0, 79.5, 59.5)
QUICK = RenderParams(shadow_texel=0.5)
NEAR = (-14.0, -14.0, 14.0, 14.0)  # of the box: shadows no further


@pytest.fixture(scope="module")
def renderer(box_mesh):
    return Renderer(box_mesh, QUICK, LightParams(), bounds=NEAR)


CAMERAS = [
    PINHOLE,
    Pinhole(160, 120, 95.0, 95.0, 79.5, 59.5, (-0.2, 0.05, 1e-3, 0.0, 0.0)),
    Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, -0.005, 0.0, 0.0)),
    Spherical(160, 80),
]


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.model)
def test_range_is_exact_along_the_ray_of_every_camera(renderer, camera):
    rotation = np.eye(3) if camera.model == "spherical" else OPTICAL
    T_world_camera = SE3.from_planar(0.2, 0.1, 0.15) @ SE3.from_parts(rotation, [0, 0, 1.5])
    _, ranges = renderer.render(camera, T_world_camera)
    rays = camera.unproject(pixel_grid(camera)) @ T_world_camera.rotation.T
    points = T_world_camera.translation + rays * np.where(np.isfinite(ranges), ranges, 0.0)[..., None]
    on_ground = (rays[..., 2] < -0.1) & (np.abs(points[..., 2]) < 1e-4)
    np.testing.assert_allclose(ranges[on_ground], (-1.5 / rays[..., 2])[on_ground], rtol=2e-6)
    on_face = (np.abs(points[..., 0] - 5.0) < 1e-4) & (points[..., 2] > 0.01)
    assert on_ground.sum() > 1000
    assert on_face.sum() > 40
    assert np.all(np.abs(points[on_face][:, 1]) < 1.0 + 1e-4)
    assert np.all(np.isinf(ranges[rays[..., 2] > 0.4]))


def test_outside_the_lens_there_is_nothing(renderer, looking_along_x):
    camera = Fisheye(160, 160, 40.0, 40.0, 79.5, 79.5, (-0.1, 0.0, 0.0, 0.0))
    image, ranges = renderer.render(camera, looking_along_x)
    outside = np.isnan(camera.unproject(pixel_grid(camera))[..., 0])
    assert 0 < outside.sum() < outside.size
    assert np.all(np.isnan(ranges[outside]))
    assert np.all(image[outside] == 0.0)
    assert np.all(image[~outside] > 0.0)


def test_finer_rays_are_those_of_the_parts_of_a_pixel():
    pixels = np.array([[80.0, 60.0], [3.0, 5.0], [159.0, 0.0]])  # at a border by the neighbour that there is
    edges = (pixels @ [1, 160]).astype(int)
    found = _split(PINHOLE.unproject(pixel_grid(PINHOLE)).astype(np.float32), edges, 2).reshape(3, 4, 3)
    parts = np.array([[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]])  # u, v
    np.testing.assert_allclose(found, PINHOLE.unproject(pixels[:, None] + parts), atol=2e-5)
