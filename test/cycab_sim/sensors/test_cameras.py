import numpy as np
import pytest

from cycab_sim.params import ImagingParams, SimCameraParams, SphereParams
from cycab_sim.sensors.cameras import expose, forward_camera, roof_sphere, vignette
from sphere_nav.geometry import Pinhole


def test_the_forward_camera_looks_forward_and_a_little_down():
    mount = forward_camera(SimCameraParams(pitch_deg=5.0), ImagingParams())
    axis, right, down = mount.T_base_camera.rotation.T[[2, 0, 1]]
    np.testing.assert_allclose(axis, [np.cos(np.radians(5)), 0.0, -np.sin(np.radians(5))], atol=1e-12)
    np.testing.assert_allclose(right, [0.0, -1.0, 0.0], atol=1e-12)
    assert down[2] < -0.99
    np.testing.assert_allclose(mount.T_base_camera.translation, [1.0, 0.0, 1.6])


def test_a_panorama_has_body_axes():
    params = SimCameraParams(model="panorama", width=720, height=360, pitch_deg=0.0)
    mount = forward_camera(params, ImagingParams(vignetting=0.3))
    assert mount.imaging.vignetting == 0.0  # it has no corners
    np.testing.assert_allclose(mount.T_base_camera.rotation, np.eye(3), atol=1e-12)
    assert mount.frame_id == "camera_link"


def test_the_sphere_sees_everything_from_the_roof():
    mount = roof_sphere(SphereParams(width=256))
    assert mount.camera.is_whole
    np.testing.assert_allclose(mount.T_base_camera.rotation, np.eye(3))
    with pytest.raises(ValueError, match=r"sphere\.width: expected an even number, found 255"):
        roof_sphere(SphereParams(width=255))


def test_noise_has_its_size_and_belongs_to_its_image():
    levels = np.full((200, 200), 120.0, np.float32)
    image = expose(levels, 1.5, 0.02, (1, 7))
    # the variances of electronics, of light, and of rounding to whole levels
    assert image.std() == pytest.approx(np.sqrt(1.5**2 + 0.02 * 120 + 1 / 12), rel=0.03)
    assert image.mean() == pytest.approx(120.0, abs=0.05)
    np.testing.assert_array_equal(image, expose(levels, 1.5, 0.02, (1, 7)))
    assert np.mean(image == expose(levels, 1.5, 0.02, (1, 8))) < 0.3


def test_vignetting_takes_its_share_of_the_light_in_the_corners_and_none_in_the_middle():
    fall = vignette(Pinhole(81, 61, 50.0, 50.0, 40.0, 30.0), 0.4, 2.2)
    assert fall.shape == (61, 81)
    assert fall[30, 40] == 1.0
    assert fall[[0, 0, -1, -1], [0, -1, 0, -1]] ** 2.2 == pytest.approx([0.6] * 4, abs=1e-5)
    assert fall[30, 0] > fall[0, 0]
    assert forward_camera(SimCameraParams(), ImagingParams(vignetting=0.3)).imaging.vignetting == 0.3


def test_levels_stay_in_range_and_zero_is_kept_for_the_unseen():
    levels = np.array([[0.0, 0.4, 254.9, 300.0]], np.float32)
    assert expose(levels, 0.0, 0.0, ()).tolist() == [[0, 1, 255, 255]]
    assert expose(levels, 0.0, 0.0, (), bias=-20.0).tolist() == [[0, 1, 235, 255]]
    noisy = expose(np.zeros((50, 50), np.float32), 20.0, 0.0, (1,))
    assert not noisy.any()
