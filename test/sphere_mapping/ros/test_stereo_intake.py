"""The geometry of a stereo pair from its messages: P and R, or a transform; what is lacking is named."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.stereo_field import RowFit, StereoField
from sphere_mapping.acquisition.stereo.stereo_pair import PairGeometry, StereoPair, geometry_of
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_mapping.ros.stereo_intake import StereoIntake, describe_rows, open_pair, report_nothing
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros.camera.synchronizer import Instant
from sphere_nav.ros.conversions import camera_to_info

RAW = Pinhole(320, 240, 250.0, 251.0, 160.0, 119.0, (-0.2, 0.03, 0.0, 0.0, 0.0))
T_LEFT_RIGHT = SE3.exp([0.2, 0.01, 0.0, 0.01, 0.02, 0.01])


def infos(*, is_told):
    """Return both infos as a driver of a calibrated pair gives them, or of two cameras that know only themselves."""
    g = geometry_of(RAW, RAW, T_LEFT_RIGHT)
    found = []
    for frame, R, baseline_m in (("l", g.R_rectified_left, 0.0), ("r", g.R_rectified_right, g.baseline_m)):
        info = camera_to_info(RAW, 1, frame)
        if is_told:
            c = g.camera
            info.r = [float(value) for value in R.ravel()]
            info.p = [c.fx, 0.0, c.cx, -c.fx * baseline_m, 0.0, c.fy, c.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
        found.append(info)
    return found


def unknown(target, source):
    raise ValueError(f"no transform from {source} to {target}")


def test_projections_and_a_transform_tell_the_same_pair():
    pairs = [open_pair(*infos(is_told=True), unknown), open_pair(*infos(is_told=False), lambda *_: T_LEFT_RIGHT)]
    for name in ("left", "right", "camera"):
        assert np.allclose(getattr(pairs[0], name).coefficients, getattr(pairs[1], name).coefficients)
    np.testing.assert_allclose(pairs[0].R_rectified_right, pairs[1].R_rectified_right, atol=1e-12)
    assert pairs[0].baseline_m == pytest.approx(pairs[1].baseline_m)
    assert not pairs[0].is_rectified


def test_a_rectified_pair_is_taken_as_it_is():
    camera = Pinhole(320, 240, 250.0, 250.0, 160.0, 119.0)
    geometry = open_pair(camera_to_info(camera, 1, "l"), camera_to_info(camera, 1, "l", baseline=0.3), unknown)
    assert geometry.is_rectified
    assert geometry.baseline_m == pytest.approx(0.3)


def test_rows_beyond_the_calibration_are_warned_of():
    pair = StereoPair(open_pair(*infos(is_told=True), unknown))
    assert describe_rows(pair, 0.15)[1] == "rows as told"
    pair.fit = RowFit(np.array([0.1, 0, 0, 0, 0, 0]), np.eye(6), 0.1, 0.05, 300)
    assert describe_rows(pair, 0.15) == (0, "rows off by 0.10 px, corrected by 300 corners to 0.05 px")
    level, text = describe_rows(pair, 0.05)
    assert level > 0
    assert "expected 0.05 px (stereo.calibration_px)" in text


def test_a_known_pair_corrects_the_images_from_the_first_on():
    camera, caught = Pinhole(320, 240, 250.0, 250.0, 160.0, 119.0), []
    told = camera_to_info(camera, 1, "l"), camera_to_info(camera, 1, "l", baseline=0.3)
    image = np.tile(np.arange(240, dtype=np.uint8)[:, None], (1, 320))
    instant = Instant(1, {"left/image_raw": image, "right/image_raw": image}, {})
    intake = StereoIntake(MapperParams(), unknown, report_nothing, lambda *seen: caught.append(seen))
    geometry = PairGeometry(camera, camera, np.eye(3), np.eye(3), camera, 0.3)
    intake.use(StereoPair(geometry, StereoField(rows=(3.0, 0, 0, 0, 0, 0))))
    assert intake.make(instant, CameraMount("l", True, SE3.identity()), *told) is None
    left, right, _ = caught[0]
    np.testing.assert_array_equal(left, image)
    np.testing.assert_array_equal(right[10:200], image[10:200] + 3)  # what belongs at a row is three rows below
