"""Which pictures of several cameras are one instant, and which cameras are waited for."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.localization.params import RigParams
from sphere_nav.ros.camera.rig_intake import MAX_MISSES, Instants, rig_names
from sphere_nav.ros.camera.stream import Picture

CAMERA = Pinhole(4, 2, 3.0, 3.0, 1.5, 0.5)
MS = 1_000_000
PERIOD = 100 * MS


class Gate:
    def __init__(self, names=("a", "b")):
        self.said = []
        self.instants = Instants(names, 0.015, lambda pictures: self.said.append(self.describe(pictures)))

    @staticmethod
    def describe(pictures):
        return {name: picture.stamp_ns // MS for name, picture in pictures.items()}

    def add(self, name, stamp_ms):
        picture = Picture(np.zeros((2, 4), np.uint8), CAMERA, stamp_ms * MS, SE3.identity(), None, name)
        self.instants.add(name, picture)
        return self.said[-1] if self.said else None


def test_an_instant_is_complete_with_all_cameras_in_the_order_of_their_names():
    gate = Gate()
    assert gate.add("b", 1005) is None
    assert gate.add("a", 1000) == {"a": 1000, "b": 1005}
    assert list(gate.said[0]) == ["a", "b"]


def test_the_next_instant_ends_one_that_lacks_a_camera():
    gate = Gate()
    gate.add("a", 1000)
    assert gate.add("a", 1100) == {"a": 1000}
    assert gate.add("b", 1110) == {"a": 1100, "b": 1110}


def test_a_camera_that_stays_away_is_not_waited_for_until_it_is_back():
    gate = Gate()
    for k in range(MAX_MISSES + 1):
        gate.add("a", 1000 + 100 * k)
    assert len(gate.said) == MAX_MISSES + 1  # the last one at once
    with pytest.raises(ValueError, match="camera b"):
        gate.add("b", 1000 + 100 * MAX_MISSES + 2)  # after its instant was handed on
    gate.add("a", 2000)
    assert gate.said[-1] != {"a": 2000}
    assert gate.add("b", 2001) == {"a": 2000, "b": 2001}


def test_stamps_of_another_time_begin_anew():
    gate = Gate()
    gate.add("a", 5000)
    gate.add("b", 5000)
    gate.add("a", 1000)
    assert gate.add("b", 1000) == {"a": 1000, "b": 1000}


def test_names_are_those_of_the_calibration_unless_some_are_chosen():
    rig = Rig(tuple(RigCamera(name, CAMERA, SE3.identity()) for name in ("a", "b", "c")))
    assert rig_names(RigParams(), rig) == ("a", "b", "c")
    assert rig_names(RigParams(cameras="c, a"), rig) == ("c", "a")
    assert rig_names(RigParams(cameras="left,right"), None) == ("left", "right")
    for words in ("d", "a,a"):
        with pytest.raises(ValueError, match="expected different names"):
            rig_names(RigParams(cameras=words), rig)
    with pytest.raises(ValueError, match="found none"):
        rig_names(RigParams(), None)
