"""Where a camera sits on the vehicle, told by hand."""

import re

import numpy as np
import pytest

from sphere_nav.ros.camera.mounting import read_mounting


def test_six_numbers_turn_about_the_fixed_axes_of_the_vehicle():
    mounting = read_mounting("1,2,3,0,0.1,1.5707963267948966")
    # ahead of the camera is left of the vehicle; pitched down by 0.1 rad
    expected = [1.0, 2.0 + np.cos(0.1), 3.0 - np.sin(0.1)]
    np.testing.assert_allclose(mounting.apply([1.0, 0.0, 0.0])[0], expected, atol=1e-12)
    rolled = read_mounting("0,0,0,0.2,0,0")
    np.testing.assert_allclose(rolled.apply([0.0, 1.0, 0.0])[0], [0.0, np.cos(0.2), np.sin(0.2)], atol=1e-12)


def test_a_file_says_the_same(tmp_path):
    path = tmp_path / "mount.yaml"
    path.write_text("{x: 1.0, y: 2, z: 3, roll: 0.1, pitch: 0.2, yaw: 0.3}")
    assert read_mounting(str(path)).distance(read_mounting("1,2,3,0.1,0.2,0.3")) == pytest.approx((0.0, 0.0), abs=1e-12)
    path.write_text("{x: [")
    with pytest.raises(ValueError, match=f"^--mounting: {re.escape(str(path))}: "):
        read_mounting(str(path), "--mounting")
