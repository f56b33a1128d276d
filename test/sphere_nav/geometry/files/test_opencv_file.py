"""OpenCV's FileStorage, written here by OpenCV itself."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, Pinhole
from sphere_nav.geometry.files.foreign_rig import read_foreign_rig
from worlds.foreign import refusal

MAX_SKEW = 1e-6  # written out: imported, a change would go unseen

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


def test_one_fisheye(tmp_path):
    more = {"camera_matrix": K, "distortion_coefficients": D[:, :4]}
    path = store(tmp_path / "a.yml", fisheye_model=1, image_width=640, image_height=480, **more)
    assert read_foreign_rig([path]).cameras[0].camera == Fisheye(640, 480, 535.9, 536.2, 342.3, 235.6, tuple(D[0, :4]))
    assert isinstance(read_foreign_rig([path], model="pinhole").cameras[0].camera, Pinhole)


def test_a_camera_info_file_of_ros(tmp_path):
    path = tmp_path / "head.yaml"
    text = (
        "image_width: 640\nimage_height: 480\ncamera_name: head_left\ndistortion_model: equidistant\n"
        "camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 501, 240, 0, 0, 1]}\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 4\n  data: [0.1, 0.02, 1e-05, 0]\n"
        "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
    )
    matrix = "{rows: 3, cols: 3, data: [500, 0, 320, 0, 501, 240, 0, 0, 1]}"
    for other in (matrix, "[[500, 0, 320], [0, 501, 240], [0, 0, 1]]"):
        path.write_text(text.replace(matrix, other, 1))
        rig = read_foreign_rig([path])
        assert rig.names == ("head_left",)
        assert rig.cameras[0].camera == Fisheye(640, 480, 500.0, 501.0, 320.0, 240.0, (0.1, 0.02, 1e-5, 0.0))
    for other, expected in (
        ("[[500, 0], [320]]", r"cameramatrix: expected a finite number, found \[500, 0\]"),
        ("[]", "cameramatrix: expected a matrix, found"),
        ("{rows: 3, cols: 3, data: [500, 0]}", "cameramatrix: expected a matrix, found 2 numbers"),
    ):
        path.write_text(text.replace(matrix, other, 1))
        with pytest.raises(ValueError, match=expected):
            read_foreign_rig([path])


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


def test_a_matrix_of_a_camera_without_skew_is_taken_up_to_the_limit(tmp_path):
    for row, column, limit in [(0, 1, MAX_SKEW), (1, 0, 0.0), (2, 0, 0.0), (2, 1, 0.0)]:
        for sign in (1.0, -1.0):
            matrix = K.copy()
            matrix[row, column] = sign * limit
            path = store(tmp_path / "a.yml", **GOOD | {"camera_matrix": matrix})
            assert read_foreign_rig([path]).cameras[0].camera.fx == K[0, 0]
            matrix[row, column] = sign * (limit + 1e-7)
            path = store(tmp_path / "a.yml", **GOOD | {"camera_matrix": matrix})
            with pytest.raises(ValueError, match=r"cameramatrix: expected \[fx 0 cx"):
                read_foreign_rig([path])


SIZED = {"image_width": 640, "image_height": 480}
GOOD, PAIR = SIZED | {"camera_matrix": K, "distortion_coefficients": D}, SIZED | {"M1": K, "M2": K}
DEFECTS = [
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


def test_a_defect_is_one_line_with_its_place(tmp_path):
    for values, expected in DEFECTS:
        path = store(tmp_path / "a.yml", **values)
        assert expected in refusal(lambda path: read_foreign_rig([path]), path)
