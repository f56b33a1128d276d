"""Where the camera is on the vehicle, and what a live map waits for before it begins."""

from types import SimpleNamespace

import numpy as np
from sensor_msgs.msg import Imu

from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.mount import CameraMount, VehicleFrame
from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import header
from sphere_nav.ros.tf import TransformTree
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.recordings import CAMERA, FRAME, ROOM, T_BASE_CAMERA, mount, stamp
from worlds.room import optical

SECOND = 1_000_000_000


class Vehicle:
    """A vehicle whose IMU has a publisher, or not; `said` is what it warns of."""

    def __init__(self, *, has_imu=False, **values):
        self.tree, self.said, self.removed = TransformTree(), [], []
        log = SimpleNamespace(warning=lambda text, **_: self.said.append(text))
        endpoints = SimpleNamespace(
            add_subscription=lambda topic, *_, **__: topic,
            remove_subscription=self.removed.append,
            publishers_of=lambda topic: ["driver"] if has_imu and topic == "imu" else [],
            log=log,
        )
        self.frame = VehicleFrame(endpoints, SphereMapperParams(**values), self.tree, is_live=True)

    def mount(self):
        for transform in mount().transforms:
            self.tree.add(transform, is_static=True)

    def hear(self, at_ns, force=(0.0, 0.0, 9.81), frame_id="base_link", lean=0.0):
        message = Imu(header=header(at_ns, frame_id))
        message.orientation.x, message.orientation.w = np.sin(lean / 2), np.cos(lean / 2)
        vector = message.linear_acceleration
        vector.x, vector.y, vector.z = force
        self.frame.on_imu(message)


def test_a_live_map_waits_for_its_mount_but_not_for_ever():
    vehicle = Vehicle()
    assert vehicle.frame.find(FRAME, True).distance(SE3.identity()) == (0.0, 0.0)
    assert "taking camera_optical as base_link" in vehicle.said[0]
    assert vehicle.frame.waits(SECOND)
    vehicle.mount()
    np.testing.assert_allclose(vehicle.frame.find(FRAME, True).matrix, T_BASE_CAMERA.matrix, atol=1e-12)
    assert not vehicle.frame.waits(SECOND + 1)
    late = Vehicle()
    late.frame.find(FRAME, True)
    assert late.frame.waits(SECOND)
    assert not late.frame.waits(2 * SECOND)


def test_a_sample_counts_that_says_what_is_up():
    for lean, force, is_kept in [
        (0.0, (0.0, 0.0, 9.81), True),
        (0.0, (0.0, 0.0, 0.0), False),
        (0.2, (0.0, np.nan, 9.81), False),
    ]:
        vehicle = Vehicle(has_imu=True)
        vehicle.mount()
        vehicle.frame.find(FRAME, True)
        vehicle.hear(SECOND, force, lean=lean)
        assert vehicle.frame.waits(SECOND) is not is_kept


def test_an_imu_without_a_place_or_in_another_frame_does_not_level_the_map():
    for frame_id, word in (("imu_link", "frame imu_link"), (FRAME, "within 34 deg of upright, found 90")):
        vehicle = Vehicle()
        vehicle.mount()
        T_base_body = vehicle.frame.find(FRAME, True)
        for number in range(20):
            vehicle.hear(stamp(0) + number * SECOND // 100, frame_id=frame_id)  # of an optical frame: up is ahead
        T_map_base, source = begin(vehicle, CameraMount(FRAME, True, T_base_body))
        np.testing.assert_allclose(T_map_base.matrix, np.eye(4), atol=1e-9)
        assert source == "the mounting"
        assert "imu: not used to level the map" in vehicle.said[-1]
        assert word in vehicle.said[-1]
        assert vehicle.removed == ["imu"]


def test_an_optical_frame_as_base_begins_a_map_whose_z_is_up():
    vehicle = Vehicle(base_frame=FRAME)
    vehicle.tree.add(mount().transforms[1], is_static=True)
    T_base_body = vehicle.frame.find(FRAME, True)
    np.testing.assert_allclose(T_base_body.matrix, T_BODY_OPTICAL.inverse().matrix, atol=1e-12)
    T_map_base, _ = begin(vehicle, CameraMount(FRAME, True, T_base_body))
    np.testing.assert_allclose(T_map_base.matrix, T_BODY_OPTICAL.matrix, atol=1e-12)


def begin(vehicle, place):
    image, depth_m = ROOM.rgbd(CAMERA, optical(SE3.identity()))
    return vehicle.frame.begin(sphere_from_rgbd(image, depth_m, CAMERA, stamp_ns=stamp(0)), place)
