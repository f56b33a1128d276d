import numpy as np
import pytest

from cycab_sim.params import CameraRigParams, ImagingParams, SimCameraParams
from cycab_sim.sensors.cameras import (
    OPTICAL,
    forward_camera,
    make_lens,
    make_rig,
    planned_pose,
    rig_camera_names,
    rig_mounts,
    rig_place,
)
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


EXACT = CameraRigParams(kind="vertical", tolerance=0.0)


def axes(rig):
    return np.array([camera.T_rig_camera.rotation[:, 2] for camera in rig.cameras])


def places(rig):
    return np.array([camera.T_rig_camera.translation for camera in rig.cameras])


def test_three_pairs_stand_back_to_back_one_above_the_other():
    rig = make_rig(EXACT, 1)
    assert rig.names == rig_camera_names("vertical")
    assert [camera.level for camera in rig.cameras] == ["top"] * 3 + ["bottom"] * 3
    top, bottom = places(rig)[:3], places(rig)[3:]
    np.testing.assert_allclose(top - bottom, np.tile([0.0, 0.0, 0.3], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(axes(rig)[:3], axes(rig)[3:], atol=1e-12)
    np.testing.assert_allclose(axes(rig)[0], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(top.mean(axis=0), 0.0, atol=1e-12)
    assert np.degrees(np.arccos(axes(rig)[0] @ axes(rig)[1])) == pytest.approx(120.0)


def test_cameras_are_mounted_nearly_as_planned_and_each_seed_otherwise():
    params = CameraRigParams(kind="ring")
    rig, again, other = make_rig(params, 3), make_rig(params, 3), make_rig(params, 4)
    np.testing.assert_array_equal(places(rig), places(again))
    assert not np.allclose(places(rig), places(other))
    for camera in rig.cameras:
        error = planned_pose(params, camera.name).inverse() @ camera.T_rig_camera
        assert 0.0 < np.linalg.norm(error.translation) < 5e-3  # five times its deviation
        assert 0.0 < np.linalg.norm(error.log()[3:]) < np.radians(1.5)
    assert len({camera.camera.fx for camera in rig.cameras}) == 6


def test_mounts_are_the_rig_on_the_car():
    params = CameraRigParams(kind="vertical")
    rig = make_rig(params, 3)
    mounts = rig_mounts(params, ImagingParams(), rig)
    assert [mount.name for mount in mounts] == list(rig.names)
    np.testing.assert_allclose(rig_place(params).translation, [0.4, 0.0, 1.8])
    for mount, camera in zip(mounts, rig.cameras, strict=True):
        found = rig_place(params).inverse() @ mount.T_base_camera
        np.testing.assert_allclose(found.matrix, camera.T_rig_camera.matrix, atol=1e-12)
    assert make_rig(CameraRigParams(), 3) is None
    assert rig_mounts(CameraRigParams(), ImagingParams(), None) == ()
