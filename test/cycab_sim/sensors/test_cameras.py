import numpy as np
import pytest

from cycab_sim.params import CameraRigParams, ImagingParams, SimCameraParams
from cycab_sim.sensors.cameras import OPTICAL, forward_camera, make_lens
from sphere_nav.geometry import SE3


def test_the_forward_camera_is_where_its_six_numbers_put_it_and_a_panorama_has_body_axes():
    mount = forward_camera(SimCameraParams(mounting_deg="0.7,-0.2,1.3,10,-20,150"), ImagingParams())
    expected = SE3.from_angles(*np.radians([10.0, -20.0, 150.0]), [0.7, -0.2, 1.3])
    np.testing.assert_allclose(mount.T_base_camera.rotation, expected.rotation @ OPTICAL, atol=1e-12)
    np.testing.assert_array_equal(mount.T_base_camera.translation, [0.7, -0.2, 1.3])
    params = SimCameraParams(model="panorama", size="720,360", mounting_deg="1,0,1.6,0,0,0")
    mount = forward_camera(params, ImagingParams(vignetting=0.3))
    assert mount.imaging.vignetting == 0.0  # it has no corners
    np.testing.assert_allclose(mount.T_base_camera.rotation, np.eye(3), atol=1e-12)
    assert mount.frame_id == "camera_link"


def test_the_field_of_view_is_met_with_the_distortion():
    for params in [
        SimCameraParams(view_deg=80.0),
        SimCameraParams(model="fisheye", view_deg=190.0, size="500,400"),
        CameraRigParams(view_deg=185.0),
        CameraRigParams(model="pinhole", view_deg=125.0),
    ]:
        camera = make_lens(params, "camera")
        assert camera.model == params.model
        columns, rows = params.columns_rows
        middle = (rows - 1) / 2
        edges = camera.unproject([[-0.5, middle], [columns - 0.5, middle]])
        azimuth = np.degrees(np.arctan2(edges[:, 0], edges[:, 2]))
        assert azimuth == pytest.approx([-params.view_deg / 2, params.view_deg / 2], abs=1e-6)
