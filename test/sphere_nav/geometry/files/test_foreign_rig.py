"""Files of other programs: Kalibr's poses point the other way than ours, OpenCV's are written here by OpenCV itself."""

import json

import cv2
import numpy as np
import pytest
import yaml

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Omni, Pinhole
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.files.foreign_rig import read_foreign_rig
from worlds.foreign import refusal

MAX_SKEW = 1e-6  # written out: imported, a change would go unseen
PLANE = ("fx", "fy", "cx", "cy")
POSES = tuple(SE3.exp(xi) for xi in np.random.default_rng(7).normal(0.0, 0.7, (5, 6)))  # T_imu_camera


@pytest.fixture
def path(tmp_path):
    return tmp_path / "calibration.yaml"


def read(path):
    return read_foreign_rig([path])


CAM0 = {"camera_model": "pinhole", "intrinsics": [500.0, 500.0, 320.0, 240.0], "resolution": [640, 480]}


def pinhole(*plane):
    return json.dumps({"cam0": CAM0 | {"intrinsics": plane}})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected a Kalibr camchain"),
        ("- 1", "expected a Kalibr camchain"),
        ("[" * 5000, "expected YAML"),
        ("cam0:\n  camera_model: [ds]\n  intrinsics: 1\n  resolution: 2", "cam0.camera_model: expected pinhole"),
        (
            pinhole(500, 501, 9000, 240),
            "cam0.intrinsics: expected the centre inside the 640 x 480 image, found",
        ),
        (
            pinhole(-1, 501, 320, 240),
            "cam0.intrinsics: focal length: expected positive fx, fy",
        ),
    ],
    ids=range(6),
)
def test_a_file_that_is_none_is_one_line(path, text, expected):
    path.write_text(text)
    line = refusal(read, path)
    assert expected in line
    assert len(line) < 600


def test_a_camchain_is_one_file(path):
    path.write_text(json.dumps({"cam0": CAM0}))
    assert read(path).names == ("cam0",)
    with pytest.raises(ValueError, match="expected one file of Kalibr or basalt, found 2"):
        read_foreign_rig([path, path])


# --- Kalibr
CAMERAS = (
    Pinhole(752, 480, 458.654, 457.296, 367.215, 248.375, (-0.283, 0.0739, 1.9e-4, 1.7e-05)),
    Fisheye(640, 512, 275.5, 275.4, 315.4, 248.0, (-0.0068, 0.0137, -0.0087, 0.0016)),
    DoubleSphere(1216, 1200, 225.0, 222.6, 610.8, 602.7, -0.28, 0.57),
    Pinhole(640, 480, 500.0, 501.0, 320.0, 240.0),
)


def lens_of(camera):
    numbers = [getattr(camera, name) for name in PLANE]
    if isinstance(camera, DoubleSphere):
        return {"camera_model": "ds", "intrinsics": [camera.xi, camera.alpha, *numbers]}
    kind = "equidistant" if isinstance(camera, Fisheye) else "radtan" if camera.distortion else "none"
    more = {"distortion_model": kind, "distortion_coeffs": list(camera.distortion)}
    return {"camera_model": "pinhole", "intrinsics": numbers, **more}


def camchain(*, with_chain=True, with_imu=True):
    values = {}
    for number, (camera, pose) in enumerate(zip(CAMERAS, POSES, strict=False)):
        entry = lens_of(camera) | {"resolution": [camera.width, camera.height], "rostopic": f"/cam{number}"}
        entry |= {"cam_overlaps": [0], "timeshift_cam_imu": -8.1e-05}
        if with_imu:
            entry["T_cam_imu"] = pose.inverse().matrix.tolist()
        if with_chain and number:
            entry["T_cn_cnm1"] = (pose.inverse() @ POSES[number - 1]).matrix.tolist()
        values[f"cam{number}"] = entry
    return values


def test_what_kalibr_writes_is_read(path):
    for ways in [{}, {"with_imu": False}, {"with_chain": False}]:
        path.write_text(yaml.safe_dump(camchain(**ways)))
        is_by_imu = ways.get("with_imu", True)
        found = read_foreign_rig([path], "imu" if is_by_imu else "camera")
        assert [mine.camera for mine in found.cameras] == list(CAMERAS)
        for mine, theirs in zip(found.cameras, POSES, strict=False):
            expected = theirs if is_by_imu else T_BODY_OPTICAL @ POSES[0].inverse() @ theirs
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


@pytest.mark.parametrize(("kind", "distortion"), [("none", ()), ("radtan", (-0.27, 0.11, -1e-3, 2e-3))])
def test_kalibrs_omni_is_meis_camera(path, kind, distortion):
    path.write_text(CAMCHAIN_OMNI.format(", ".join(map(str, distortion)), kind))
    (found,) = read(path).cameras
    assert found.camera == Omni(752, 480, 833.0, 830.0, 373.0, 253.0, 0.9, distortion)


def put(name, field, value):
    return lambda values: values[name].__setitem__(field, value)


def drop_poses(values):
    del values["cam3"]["T_cn_cnm1"]
    for one in values.values():
        del one["T_cam_imu"]


TURNED = SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.1]).matrix.tolist()
KALIBR_DEFECTS = [
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


# --- basalt
SIZE = (640, 480)
RADTAN8 = (0.1, 0.02, 1e-3, -2e-4, 0.003, 0.2, 0.03, 0.001)
LENSES = {
    "ds": DoubleSphere(*SIZE, 225.0, 222.6, 310.8, 242.7, -0.28, 0.57),
    "ucm": DoubleSphere(*SIZE, 225.0, 222.6, 310.8, 242.7, 0.0, 0.61),
    "kb4": Fisheye(*SIZE, 275.5, 275.4, 315.4, 248.0, (-0.0068, 0.0137, -0.0087, 0.0016)),
    "pinhole": Pinhole(*SIZE, 500.0, 501.0, 320.0, 240.0),
    "pinhole-radtan8": Pinhole(*SIZE, 500.0, 501.0, 320.0, 240.0, RADTAN8),
}
FURTHER = {
    "ds": ("xi", "alpha"),
    "ucm": ("alpha",),
    "kb4": ("k1", "k2", "k3", "k4"),
    "pinhole": (),
    "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}


def basalt():
    poses, lenses = [], []
    for (kind, camera), pose in zip(LENSES.items(), POSES, strict=True):
        own = {"xi": camera.xi, "alpha": camera.alpha} if isinstance(camera, DoubleSphere) else {}
        own |= dict(zip(FURTHER[kind], getattr(camera, "distortion", ()), strict=False))
        lens = {name: getattr(camera, name) for name in PLANE}
        more = {"rpmax": 2.7} if kind == "pinhole-radtan8" else {}
        lenses.append({"camera_type": kind, "intrinsics": lens | {name: own[name] for name in FURTHER[kind]} | more})
        keys = ("px", "py", "pz", "qx", "qy", "qz", "qw")
        poses.append(dict(zip(keys, [*map(float, pose.translation), *map(float, pose.quaternion)], strict=True)))
    return {"value0": {"T_imu_cam": poses, "intrinsics": lenses, "resolution": [list(SIZE)] * 5, "gyro_noise_std": 0.1}}


def test_what_basalt_writes_is_read_and_placed_by_the_imu_or_by_the_first_camera(path):
    path.write_text(json.dumps(basalt(), indent=4))
    rig = read_foreign_rig([path], frame="imu")
    assert [part.camera for part in rig.cameras] == list(LENSES.values())
    for mine, pose in zip(rig.cameras, POSES, strict=True):
        np.testing.assert_allclose(mine.T_rig_camera.matrix, pose.matrix, atol=1e-12)
    first, *others = (part.T_rig_camera for part in read(path).cameras)
    np.testing.assert_allclose(first.rotation @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    for mine, pose in zip(others, POSES[1:], strict=True):
        np.testing.assert_allclose((first.inverse() @ mine).matrix, (POSES[0].inverse() @ pose).matrix, atol=1e-12)


def put_lens(index, field, value):
    return lambda values: values["value0"]["intrinsics"][index].__setitem__(field, value)


ALPHA = {**dict.fromkeys(PLANE, 300.0), "xi": 0.0, "alpha": 2.0}
BASALT_DEFECTS = [
    (put_lens(1, "camera_type", "eucm"), "intrinsics[1].camera_type: expected ds, ucm, kb4"),
    (lambda v: v["value0"]["T_imu_cam"].pop(), "found 4 of T_imu_cam, 5 of intrinsics, 5 of resolution"),
    (lambda v: v["value0"]["T_imu_cam"][0].update(qw=9.0), "expected a unit quaternion, found one of"),
    (lambda v: v["value0"].pop("resolution"), "value0.resolution: expected a value, found none"),
    (put_lens(0, "intrinsics", ALPHA), "alpha"),
]


@pytest.mark.parametrize(("make", "defects"), [(camchain, KALIBR_DEFECTS), (basalt, BASALT_DEFECTS)])
def test_a_defect_is_one_line_with_its_place(path, make, defects):
    for change, expected in defects:
        values = make()
        change(values)
        path.write_text(yaml.safe_dump(values))
        assert expected in refusal(read, path)


# --- OpenCV
K = np.array([[535.9, 0.0, 342.3], [0.0, 536.2, 235.6], [0.0, 0.0, 1.0]])
K2 = K + np.diag([7.0, 6.0, 0.0])
D = np.array([[-0.266, -0.0386, 1.78e-3, -2.8e-05, 0.238]])
T_RIGHT_LEFT = SE3.exp([-0.12, 0.001, 0.002, 0.01, -0.02, 0.005])


def store(path, **values):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


def test_one_fisheye(path):
    more = {"camera_matrix": K, "distortion_coefficients": D[:, :4]}
    store(path, fisheye_model=1, image_width=640, image_height=480, **more)
    assert read(path).cameras[0].camera == Fisheye(640, 480, 535.9, 536.2, 342.3, 235.6, tuple(D[0, :4]))
    assert isinstance(read_foreign_rig([path], model="pinhole").cameras[0].camera, Pinhole)


def test_a_camera_info_file_of_ros(path):
    text = (
        "image_width: 640\nimage_height: 480\ncamera_name: head_left\ndistortion_model: equidistant\n"
        "camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 501, 240, 0, 0, 1]}\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 4\n  data: [0.1, 0.02, 1e-05, 0]\n"
        "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
    )
    matrix = "{rows: 3, cols: 3, data: [500, 0, 320, 0, 501, 240, 0, 0, 1]}"
    for other in (matrix, "[[500, 0, 320], [0, 501, 240], [0, 0, 1]]"):
        path.write_text(text.replace(matrix, other, 1))
        rig = read(path)
        assert rig.names == ("head_left",)
        assert rig.cameras[0].camera == Fisheye(640, 480, 500.0, 501.0, 320.0, 240.0, (0.1, 0.02, 1e-5, 0.0))
    for other, expected in (
        ("[[500, 0], [320]]", "cameramatrix: expected a finite number, found [500, 0]"),
        ("[]", "cameramatrix: expected a matrix, found"),
        ("{rows: 3, cols: 3, data: [500, 0]}", "cameramatrix: expected a matrix, found 2 numbers"),
    ):
        path.write_text(text.replace(matrix, other, 1))
        assert expected in refusal(read, path)


def test_a_stereo_pair_of_two_files_stands_as_opencv_says(tmp_path):
    intrinsics = store(tmp_path / "intrinsics.yml", M1=K, D1=D, M2=K2, D2=D)
    R, t = T_RIGHT_LEFT.rotation, T_RIGHT_LEFT.translation.reshape(3, 1)
    extrinsics = store(tmp_path / "extrinsics.yml", R=R, T=1000.0 * t, R1=np.eye(3), Q=np.eye(4))
    rig = read_foreign_rig([intrinsics, extrinsics], image_size=(640, 480), unit_m=0.001)
    left, right = (part.T_rig_camera for part in rig.cameras)
    np.testing.assert_allclose((right.inverse() @ left).matrix, T_RIGHT_LEFT.matrix, atol=1e-12)
    assert right.translation[1] < -0.1  # the right camera is to the right: y points left
    # and the pixels are those of OpenCV's own projection
    points_left = np.random.default_rng(1).normal(size=(20, 3)) * 0.3 + [0.0, 0.0, 2.0]
    expected, _ = cv2.projectPoints(points_left, cv2.Rodrigues(R)[0], t, K2, D)
    found, _ = rig.cameras[1].camera.project((right.inverse() @ left).apply(points_left))
    np.testing.assert_allclose(found, expected[:, 0], atol=1e-6)


def test_a_matrix_of_a_camera_without_skew_is_taken_up_to_the_limit(path):
    for row, column, limit in [(0, 1, MAX_SKEW), (1, 0, 0.0), (2, 0, 0.0), (2, 1, 0.0)]:
        for sign in (1.0, -1.0):
            matrix = K.copy()
            matrix[row, column] = sign * limit
            assert read(store(path, **GOOD | {"camera_matrix": matrix})).cameras[0].camera.fx == K[0, 0]
            matrix[row, column] = sign * (limit + 1e-7)
            line = refusal(read, store(path, **GOOD | {"camera_matrix": matrix}))
            assert "cameramatrix: expected [fx 0 cx" in line


SIZED = {"image_width": 640, "image_height": 480}
GOOD, PAIR = SIZED | {"camera_matrix": K, "distortion_coefficients": D}, SIZED | {"M1": K, "M2": K}
OPENCV_DEFECTS = [
    ({"camera_matrix": K}, "image_width, image_height: expected in the file, or --size, found neither"),
    (GOOD | {"distortion_coefficients": np.ones((12, 1))}, "found 'thin prism or tilted sensor', which is not"),
    (GOOD | {"fisheye_model": 1}, "distortion: expected 4 finite numbers, found"),
    (GOOD | {"distortion_model": "fov"}, "distortion_model: expected pinhole, plumb_bob"),
    (GOOD | {"distortion_coefficients": np.zeros((7, 1))}, "expected 4, 5, 8, 12 or 14 numbers, found 7"),
    (SIZED | {"M1": K, "R": np.eye(3), "T": np.ones((3, 1))}, "M2: expected a camera matrix"),
    (PAIR, "expected R and T of the second camera"),
    (PAIR | {"R": np.eye(3), "T": np.ones((2, 1))}, "R, T: expected 3 x 3 and 3 numbers, found 9 and 2"),
    (PAIR | {"R": np.eye(2), "T": np.ones((3, 1))}, "R, T: expected 3 x 3 and 3 numbers, found 4 and 3"),
    (PAIR | {"R": np.ones((3, 3)), "T": np.ones((3, 1))}, "R: rigid motion: expected a rotation"),
]


def test_a_defect_of_opencvs_files_is_one_line_with_its_place(path):
    for values, expected in OPENCV_DEFECTS:
        assert expected in refusal(read, store(path, **values))
