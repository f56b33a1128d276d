"""CameraInfo and camera models say the same, or it is refused."""

import numpy as np
import pytest

from sphere_nav.geometry import Fisheye, Pinhole, Spherical
from sphere_nav.ros.conversions import camera_from_info, camera_to_info, check_image_size, stereo_baseline
from sphere_nav.ros.conversions.cameras import has_baseline, rectification_of

PINHOLE = Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0, (0.1, -0.2, 0.001, 0.002, 0.03))
CAMERAS = [
    Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0),
    PINHOLE,
    Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0, (0.1, -0.2, 0.001, 0.002, 0.03, 0.04, 0.05, 0.06)),
    Fisheye(800, 800, 260.0, 261.0, 400.0, 399.0, (0.01, -0.02, 0.003, 0.001)),
]


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_camera_comes_back(camera):
    info = camera_to_info(camera, 5, "camera_optical")
    assert camera_from_info(info) == camera
    assert info.header.frame_id == "camera_optical"


def test_the_rectified_camera_is_that_of_the_projection_matrix():
    info = camera_to_info(PINHOLE, 0, "left")
    assert camera_from_info(info, is_rectified=True) == Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0)


def test_a_baseline():
    info = camera_to_info(CAMERAS[0], 0, "right", baseline=0.54)
    assert info.p[3] == pytest.approx(-525.0 * 0.54)
    assert stereo_baseline(info) == pytest.approx(0.54)
    with pytest.raises(ValueError, match=r"left: P\[3\]: expected -fx \* baseline < 0, found 0\.0"):
        stereo_baseline(camera_to_info(CAMERAS[0], 0, "left"))


def changed(**fields):
    info = camera_to_info(PINHOLE, 0, "front")
    for name, value in fields.items():
        setattr(info, name, value)
    return info


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"k": [0.0] * 9}, r"front: K\[0\]: expected a calibrated camera, found focal length 0"),
        ({"k": [5.0, 1.0, 3.0, 0.0, 5.0, 3.0, 0.0, 0.0, 1.0]}, "front: K: expected no skew"),
        ({"k": [float("nan"), 0.0, 3.0, 0.0, 5.0, 3.0, 0.0, 0.0, 1.0]}, "front: focal length: expected positive"),
        ({"distortion_model": "omni"}, "distortion_model: expected plumb_bob, .*equidistant, found 'omni'"),
        ({"distortion_model": ""}, "distortion_model: expected"),
        ({"distortion_model": "equidistant"}, "D: expected 4 coefficients of equidistant, found 5"),
        ({"d": [0.1] * 6}, "D: expected at most 5 coefficients of plumb_bob, found 6"),
        ({"width": 0}, "front: camera size: expected at least 1 x 1"),
        ({"width": 2**32 - 1}, "front: camera size: .* found 4294967295 x 4"),
        ({"width": 65536, "height": 65536}, "front: camera size: .* found 65536 x 65536"),
        ({"k": [5.0, 0.0, float("nan"), 0.0, 5.0, 3.0, 0.0, 0.0, 1.0]}, "front: centre: expected finite cx, cy"),
        ({"k": [5.0, 0.0, 3.0, 0.0, 5.0, float("inf"), 0.0, 0.0, 1.0]}, "front: centre: expected finite cx, cy"),
        ({"k": [1e300, 0.0, 3.0, 0.0, 5.0, 3.0, 0.0, 0.0, 1.0]}, "front: focal length: expected positive"),
    ],
)
def test_what_cannot_be_a_camera_is_refused(fields, reason):
    with pytest.raises(ValueError, match=reason):
        camera_from_info(changed(**fields))


def test_no_distortion_needs_no_name():
    assert camera_from_info(changed(distortion_model="", d=[])) == CAMERAS[0]
    assert camera_from_info(changed(d=[0.0] * 5)) == CAMERAS[0]


def test_a_region_of_interest_and_binning_keep_the_rays():
    info = changed(d=[], binning_x=2, binning_y=4)
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 100, 40, 400, 320
    camera = camera_from_info(info)
    assert (camera.width, camera.height) == (200, 80)
    small = np.array([[10.0, 20.0]])
    # the binned pixel (10, 20) sums columns 120, 121 and rows 120 to 123 of the full image
    full = np.array([[100 + 20.5, 40 + 81.5]])
    np.testing.assert_allclose(camera.unproject(small), CAMERAS[0].unproject(full), atol=1e-12)


def test_a_sphere_has_no_camera_info():
    with pytest.raises(ValueError, match="expected a pinhole or fisheye camera, found spherical: use SphereInfo"):
        camera_to_info(Spherical(64, 32), 0, "")


def test_an_image_of_another_size():
    check_image_size(PINHOLE, 640, 480)
    with pytest.raises(ValueError, match=r"image size: expected 640 x 480 \(camera_info\), found 320 x 240"):
        check_image_size(PINHOLE, 320, 240)


@pytest.mark.parametrize(("stretch", "is_rotation"), [(1.0004, True), (1.0006, False), (0.9994, False)])
def test_a_rectification_is_a_rotation_to_a_thousandth(stretch, is_rotation):
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    info = changed(r=(stretch * turn).ravel().tolist())
    if is_rotation:
        np.testing.assert_allclose(rectification_of(info), stretch * turn)
    else:
        with pytest.raises(ValueError, match="front: R: expected a rotation"):
            rectification_of(info)


def test_no_rectification_is_no_turn_and_a_mirror_is_none():
    np.testing.assert_array_equal(rectification_of(changed(r=[0.0] * 9)), np.eye(3))
    with pytest.raises(ValueError, match="R: expected a rotation"):
        rectification_of(changed(r=np.diag([1.0, 1.0, -1.0]).ravel().tolist()))


def test_a_right_camera_has_a_baseline_to_the_right():
    right = camera_to_info(CAMERAS[0], 0, "right", baseline=0.54)
    assert has_baseline(right)
    for wrong in (camera_to_info(CAMERAS[0], 0, "left"), camera_to_info(CAMERAS[0], 0, "right", baseline=-0.5)):
        assert not has_baseline(wrong)
        with pytest.raises(ValueError, match="expected -fx"):
            stereo_baseline(wrong)
    right.p[0] = 0.0
    assert not has_baseline(right)
    with pytest.raises(ValueError, match="expected -fx"):
        stereo_baseline(right)
