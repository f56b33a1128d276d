import numpy as np
import pytest

from cycab_sim.params import CameraRigParams, ImagingParams
from cycab_sim.sensors.rigs import make_rig, planned_pose, rig_camera_names, rig_mounts, rig_place

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
