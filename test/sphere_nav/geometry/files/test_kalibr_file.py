"""Kalibr's camchain: its poses point the other way than ours, its models have other names."""

import numpy as np
import pytest
import yaml

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Omni, Pinhole
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.files.foreign_rig import read_foreign_rig
from worlds.foreign import refusal

CAMERAS = (
    Pinhole(752, 480, 458.654, 457.296, 367.215, 248.375, (-0.283, 0.0739, 1.9e-4, 1.7e-05)),
    Fisheye(640, 512, 275.5, 275.4, 315.4, 248.0, (-0.0068, 0.0137, -0.0087, 0.0016)),
    DoubleSphere(1216, 1200, 225.0, 222.6, 610.8, 602.7, -0.28, 0.57),
    Pinhole(640, 480, 500.0, 501.0, 320.0, 240.0),
)
POSES = tuple(SE3.exp(xi) for xi in np.random.default_rng(7).normal(0.0, 0.7, (4, 6)))  # T_imu_camera


def lens_of(camera):
    numbers = [camera.fx, camera.fy, camera.cx, camera.cy]
    if isinstance(camera, DoubleSphere):
        return {"camera_model": "ds", "intrinsics": [camera.xi, camera.alpha, *numbers]}
    kind = "equidistant" if isinstance(camera, Fisheye) else "radtan" if camera.distortion else "none"
    more = {"distortion_model": kind, "distortion_coeffs": list(camera.distortion)}
    return {"camera_model": "pinhole", "intrinsics": numbers, **more}


def camchain(*, with_chain=True, with_imu=True):
    values = {}
    for number, (camera, pose) in enumerate(zip(CAMERAS, POSES, strict=True)):
        entry = lens_of(camera) | {"resolution": [camera.width, camera.height], "rostopic": f"/cam{number}"}
        entry |= {"cam_overlaps": [0], "timeshift_cam_imu": -8.1e-05}
        if with_imu:
            entry["T_cam_imu"] = pose.inverse().matrix.tolist()
        if with_chain and number:
            entry["T_cn_cnm1"] = (pose.inverse() @ POSES[number - 1]).matrix.tolist()
        values[f"cam{number}"] = entry
    return values


@pytest.fixture
def path(tmp_path):
    return tmp_path / "camchain.yaml"


def test_what_kalibr_writes_is_read(path):
    for ways in [{}, {"with_imu": False}, {"with_chain": False}]:
        path.write_text(yaml.safe_dump(camchain(**ways)))
        is_by_imu = ways.get("with_imu", True)
        found = read_foreign_rig([path], "imu" if is_by_imu else "camera")
        for mine, camera, theirs in zip(found.cameras, CAMERAS, POSES, strict=True):
            expected = theirs if is_by_imu else T_BODY_OPTICAL @ POSES[0].inverse() @ theirs
            assert mine.camera == camera
            np.testing.assert_allclose(mine.T_rig_camera.matrix, expected.matrix, atol=1e-12)
    values = camchain(with_chain=False)  # and poses of the cameras in the IMU
    for entry in values.values():
        entry["T_imu_cam"] = np.linalg.inv(entry.pop("T_cam_imu")).tolist()
    path.write_text(yaml.safe_dump(values))
    last = read_foreign_rig([path], "imu").cameras[3]
    np.testing.assert_allclose(last.T_rig_camera.matrix, POSES[3].matrix, atol=1e-9)


CAMCHAIN_OMNI = """\
cam0:
  cam_overlaps: []
  camera_model: omni
  distortion_coeffs: [{0}]
  distortion_model: {1}
  intrinsics: [0.9, 833.0, 830.0, 373.0, 253.0]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
"""  # as Kalibr writes it: xi fu fv pu pv


def test_kalibrs_omni_is_meis_camera(path):
    for distortion in [(), (-0.27, 0.11, -1e-3, 2e-3)]:
        words = (", ".join(map(str, distortion)), "radtan" if distortion else "none")
        path.write_text(CAMCHAIN_OMNI.format(*words))
        (found,) = read_foreign_rig([path]).cameras
        assert found.camera == Omni(752, 480, 833.0, 830.0, 373.0, 253.0, 0.9, distortion)


def put(name, field, value):
    return lambda values: values[name].__setitem__(field, value)


def drop_poses(values):
    del values["cam3"]["T_cn_cnm1"]
    for one in values.values():
        del one["T_cam_imu"]


TURNED = SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.1]).matrix.tolist()
DEFECTS = [
    (put("cam1", "camera_model", "eucm"), "cam1.camera_model: expected pinhole with radtan"),
    (put("cam0", "distortion_coeffs", [0.1]), "cam0.distortion_coeffs: expected 4 numbers, found 1"),
    (put("cam0", "resolution", 752), "cam0.resolution: expected list, found 752"),
    (put("cam2", "T_cam_imu", TURNED), "cam2.T_cam_imu: expected what T_cn_cnm1 and the camera"),
    (lambda v: v.pop("cam1"), "camchain: expected cam0 to cam2, found cam0, cam2, cam3"),
    (put("cam0", "distortion_model", "fov"), "cam0.distortion_model: expected pinhole with"),
    (put("cam2", "distortion_model", "radtan"), "cam2.distortion_model: expected pinhole with"),
    (drop_poses, "cam3.T_cn_cnm1: expected a pose, found none, nor T_cam_imu of all cameras"),
    (lambda v: v.update(cam3=7), "cam3: expected the fields camera_model, intrinsics"),
]


def test_a_defect_is_one_line_with_its_place(path):
    for change, expected in DEFECTS:
        values = camchain()
        change(values)
        path.write_text(yaml.safe_dump(values))
        assert expected in refusal(lambda path: read_foreign_rig([path]), path)
