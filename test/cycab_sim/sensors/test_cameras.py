from types import SimpleNamespace

import numpy as np
import pytest

from cycab_sim.params import CameraRigParams, ImagingParams, SimCameraParams, SphereParams
from cycab_sim.sensors.cameras import OPTICAL, focal_length, forward_camera, make_lens, panorama, roof_sphere
from sphere_nav.geometry import SE3


def test_the_forward_camera_looks_forward_and_a_little_down():
    mount = forward_camera(SimCameraParams(mounting_deg="1,0,1.6,0,5,0"), ImagingParams())
    axis, right, down = mount.T_base_camera.rotation.T[[2, 0, 1]]
    np.testing.assert_allclose(axis, [np.cos(np.radians(5)), 0.0, -np.sin(np.radians(5))], atol=1e-12)
    np.testing.assert_allclose(right, [0.0, -1.0, 0.0], atol=1e-12)
    assert down[2] < -0.99
    np.testing.assert_allclose(mount.T_base_camera.translation, [1.0, 0.0, 1.6])


def test_the_forward_camera_may_be_upside_down_or_on_its_side():
    for roll_deg, down in ((180.0, [0.0, 0.0, 1.0]), (90.0, [0.0, 1.0, 0.0])):
        mount = forward_camera(SimCameraParams(mounting_deg=f"1,0,1.6,{roll_deg},0,0"), ImagingParams())
        np.testing.assert_allclose(mount.T_base_camera.rotation[:, 2], [1.0, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(mount.T_base_camera.rotation[:, 1], down, atol=1e-12)


def test_the_forward_camera_is_where_its_six_numbers_put_it():
    mount = forward_camera(SimCameraParams(mounting_deg="0.7,-0.2,1.3,10,-20,150"), ImagingParams())
    expected = SE3.from_angles(*np.radians([10.0, -20.0, 150.0]), [0.7, -0.2, 1.3])
    np.testing.assert_allclose(mount.T_base_camera.rotation, expected.rotation @ OPTICAL, atol=1e-12)
    np.testing.assert_array_equal(mount.T_base_camera.translation, [0.7, -0.2, 1.3])


def test_a_panorama_has_body_axes():
    params = SimCameraParams(model="panorama", size="720,360", mounting_deg="1,0,1.6,0,0,0")
    mount = forward_camera(params, ImagingParams(vignetting=0.3))
    assert mount.imaging.vignetting == 0.0  # it has no corners
    np.testing.assert_allclose(mount.T_base_camera.rotation, np.eye(3), atol=1e-12)
    assert mount.frame_id == "camera_link"


def test_the_sphere_sees_everything_from_the_roof():
    (mount,) = roof_sphere(SphereParams(width=256))
    assert mount.camera.is_whole
    np.testing.assert_allclose(mount.T_base_camera.rotation, np.eye(3))
    with pytest.raises(ValueError, match=r"sphere\.width: expected an even number, found 255"):
        roof_sphere(SphereParams(width=255))
    assert roof_sphere(SphereParams(width=0)) == ()


def lens(**values):
    return SimpleNamespace(**({"columns_rows": (640, 480), "k2": 0.01} | values))


@pytest.mark.parametrize(
    "params",
    [
        SimCameraParams(view_deg=80.0),
        SimCameraParams(model="fisheye", view_deg=190.0, size="500,400"),
        CameraRigParams(view_deg=185.0),
        CameraRigParams(model="pinhole", view_deg=125.0),
    ],
)
def test_the_field_of_view_is_met_with_the_distortion(params):
    camera = make_lens(params, "camera")
    assert camera.model == params.model
    columns, rows = params.columns_rows
    middle = (rows - 1) / 2
    edges = camera.unproject([[-0.5, middle], [columns - 0.5, middle]])
    azimuth = np.degrees(np.arctan2(edges[:, 0], edges[:, 2]))
    assert azimuth == pytest.approx([-params.view_deg / 2, params.view_deg / 2], abs=1e-6)


def test_focal_length_without_distortion():
    pinhole = lens(model="pinhole", view_deg=90.0, k1=0.0, k2=0.0)
    assert focal_length(pinhole) == pytest.approx(320.0)
    fisheye = lens(model="fisheye", view_deg=180.0, k1=0.0, k2=0.0)
    assert focal_length(fisheye) == pytest.approx(640 / np.pi)


def test_a_panorama_keeps_rows_around_the_horizon():
    camera = make_lens(SimCameraParams(model="panorama", size="720,240"), "camera")
    rays = camera.unproject([[359.5, 119.5], [359.5, -0.5], [359.5, 239.5]])
    np.testing.assert_allclose(rays[0], [1.0, 0.0, 0.0], atol=1e-12)
    assert np.degrees(np.arcsin(rays[1:, 2])) == pytest.approx([60.0, -60.0])
    assert panorama(720, 360, "camera").is_whole


@pytest.mark.parametrize(
    ("params", "message"),
    [
        (SimCameraParams(view_deg=170.0), r"camera\.view_deg: expected at most 150.* of a pinhole, found 170"),
        (
            lens(model="pinhole", view_deg=140.0, k1=-0.2, k2=0.0),
            r"camera\.view_deg: expected at most \d+ with this distortion",
        ),
        (lens(model="fisheye", view_deg=200.0, k1=-0.3), r"camera\.view_deg: expected at most \d+ with"),
        (SimCameraParams(model="panorama", size="640,400"), r"camera\.size: .* found 640,400"),
        (SimCameraParams(model="panorama", size="641,200"), r"camera\.size: expected even numbers"),
    ],
)
def test_lenses_that_cannot_be_are_refused(params, message):
    with pytest.raises(ValueError, match=message) as caught:
        make_lens(params, "camera")
    assert "\n" not in str(caught.value)
