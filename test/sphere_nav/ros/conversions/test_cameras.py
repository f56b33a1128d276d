"""CameraInfo and camera models say the same, or it is refused."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import Pinhole, Spherical
from sphere_nav.ros.conversions import as_rectified, camera_from_info, camera_to_info
from sphere_nav.ros.conversions.cameras import has_baseline, is_rectified_topic, rectification_of, stereo_baseline

PINHOLE = Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0, (0.1, -0.2, 0.001, 0.002, 0.03))
IDEAL = Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0)


def changed(**fields):
    info = camera_to_info(PINHOLE, 0, "front")
    for name, value in fields.items():
        setattr(info, name, value)
    return info


def test_what_cannot_be_a_camera_is_refused_and_a_sphere_has_no_camera_info():
    for fields, reason in [
        ({"k": [0.0] * 9}, r"front: K\[0\]: expected a calibrated camera, found focal length 0"),
        ({"k": [float("nan"), 0.0, 3.0, 0.0, 5.0, 3.0, 0.0, 0.0, 1.0]}, "front: focal length: expected positive"),
        ({"distortion_model": "omni"}, "distortion_model: expected plumb_bob, .*equidistant, found 'omni'"),
        ({"distortion_model": "equidistant", "d": [0.1] * 5}, "D: expected at most 4 coefficients .*anew with 4"),
    ]:
        with pytest.raises(ValueError, match=reason):
            camera_from_info(changed(**fields))
    with pytest.raises(ValueError, match="expected a pinhole or fisheye camera, found spherical: use SphereInfo"):
        camera_to_info(Spherical(64, 32), 0, "")


def test_no_distortion_needs_no_name_and_coefficients_that_are_zero_do_not_count():
    assert camera_from_info(changed(distortion_model="", d=[])) == IDEAL
    assert camera_from_info(changed(d=[0.0] * 5)) == IDEAL
    padded = changed(distortion_model="equidistant", d=[0.1, 0.0, 0.0, 0.0, 0.0])
    assert camera_from_info(padded).distortion == (0.1, 0.0, 0.0, 0.0)
    d = [0.1, -0.2, 0.001, 0.002, 0.03, 0.04, 0.05, 0.06]
    info = changed(distortion_model="rational_polynomial", d=[*d, *[0.0] * 6])
    assert camera_from_info(info) == replace(PINHOLE, distortion=tuple(d))
    with pytest.raises(ValueError, match=r"at most 8 coefficients .*, found 14: rectify the images .*image_rect"):
        camera_from_info(changed(distortion_model="rational_polynomial", d=[*d, *[1e-4] * 6]))


def test_a_region_of_interest_and_binning_keep_the_rays():
    info = changed(d=[], binning_x=2, binning_y=4)
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 100, 40, 400, 320
    camera = camera_from_info(info)
    assert (camera.width, camera.height) == (200, 80)
    small = np.array([[10.0, 20.0]])
    # the binned pixel (10, 20) sums columns 120, 121 and rows 120 to 123 of the full image
    full = np.array([[100 + 20.5, 40 + 81.5]])
    np.testing.assert_allclose(camera.unproject(small), IDEAL.unproject(full), atol=1e-12)


def test_a_rectification_is_a_rotation_to_a_thousandth_and_none_is_no_turn():
    for stretch, is_rotation in [(1.0004, True), (1.0006, False), (0.9994, False)]:
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        info = changed(r=(stretch * turn).ravel().tolist())
        with nullcontext() if is_rotation else pytest.raises(ValueError, match="front: R: expected a rotation"):
            np.testing.assert_allclose(rectification_of(info), stretch * turn)
    np.testing.assert_array_equal(rectification_of(changed(r=[0.0] * 9)), np.eye(3))
    with pytest.raises(ValueError, match="R: expected a rotation"):
        rectification_of(changed(r=np.diag([1.0, 1.0, -1.0]).ravel().tolist()))


def test_a_right_camera_has_a_baseline_to_the_right_in_metres():
    right = camera_to_info(IDEAL, 0, "right", baseline=0.54)
    assert has_baseline(right)
    for wrong in (camera_to_info(IDEAL, 0, "left"), camera_to_info(IDEAL, 0, "right", baseline=-0.5)):
        assert not has_baseline(wrong)
    right.p[0] = 0.0
    assert not has_baseline(right)
    for baseline, expected in [(0.12, None), (120.0, "factor 0.001"), (0.00012, "factor 1000")]:
        right = camera_to_info(IDEAL, 0, "right", baseline=baseline)
        if expected is None:
            assert stereo_baseline(right) == pytest.approx(baseline)
            continue
        with pytest.raises(ValueError, match=rf"right: P\[3\]: baseline: expected metres, .*\({expected}\)"):
            stereo_baseline(right)


def test_what_is_rectified_is_told_by_the_name_of_its_topic():
    names = ["camera/image_rect", "left/image_rect_color/compressed", "zed/rgb/color/rect/image", "a/image_rectified"]
    for topic in names:
        assert is_rectified_topic(f"/{topic}")
    for topic in ("/camera/image_raw", "/direct/image", "/correct", "/rectangle/image_raw"):
        assert not is_rectified_topic(topic)


def test_a_calibration_is_that_of_raw_images_unless_they_are_rectified():
    raw = changed(p=[500.0, 0.0, 300.0, 0.0, 0.0, 500.0, 250.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    assert camera_from_info(as_rectified(raw, is_rectified=False)) == PINHOLE
    assert camera_from_info(as_rectified(raw)) == Pinhole(640, 480, 500.0, 500.0, 300.0, 250.0)
    assert camera_from_info(raw) == PINHOLE  # which stays as it is
    with pytest.raises(ValueError, match=r"front: P\[0\]: expected a calibrated camera of rectified images"):
        as_rectified(changed(p=[0.0] * 12))
    ideal = changed(p=[0.0] * 12, d=[])
    assert camera_from_info(as_rectified(ideal)) == IDEAL  # drivers of ideal cameras leave P empty
    many = {"distortion_model": "rational_polynomial", "d": [0.1] * 14}
    assert camera_from_info(as_rectified(changed(**many))).distortion == ()


def test_numbers_of_an_image_of_another_size_are_refused():
    for fields in (
        {"width": 320, "height": 240},  # binned, and K is not
        {"k": [262.5, 0.0, 160.0, 0.0, 260.0, 120.0, 0.0, 0.0, 1.0]},  # K is, and the size is not
        {"width": 400},  # a region, of which roi says nothing
    ):
        with pytest.raises(ValueError, match=r"expected the principal point about the middle of the image.*binning_x"):
            camera_from_info(changed(**fields))
    cut = changed()
    cut.roi.width, cut.roi.height, cut.roi.y_offset = 640, 200, 240
    assert camera_from_info(cut).height == 200  # told, so it may be anywhere
