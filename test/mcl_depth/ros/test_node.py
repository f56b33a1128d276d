"""The node on a bus: what is answered without a cloud, without calibration, and with a cloud that cannot be read."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from mcl_depth.belief.estimate import Estimate
from mcl_depth.ros import clouds
from mcl_depth.ros.node import Attitude, MclDepthNode, to_base
from mcl_depth.ros.views import Views
from sphere_nav.geometry import SE3, Spherical, so3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.node import ManagedNode
from worlds.mcl import Bench, Eye, drive, room_points

SECOND = 10**9


def picture(number):
    rng = np.random.default_rng(number)
    return conversions.array_to_image(
        rng.integers(0, 255, (64, 128)).astype(np.uint8), number * SECOND, "base_link", "mono8"
    )


def statuses(bus):
    return [item.message for item in bus.settle() if item.topic == "/status"]


@pytest.fixture
def room(tmp_path):
    rng = np.random.default_rng(1)
    side = rng.uniform((-2, -1.5, 0), (2, 1.5, 2.5), (5_000, 3))
    face = rng.integers(0, 3, len(side))
    side[face == 0, 0] = np.sign(side[face == 0, 0]) * 2
    side[face == 1, 1] = np.sign(side[face == 1, 1]) * 1.5
    side[face == 2, 2] = 0.0
    np.save(tmp_path / "room.npy", side.astype(np.float32))
    return tmp_path / "room.npy"


def test_without_a_cloud_every_image_is_answered_by_no_map():
    bus = OfflineBus()
    bus.add(MclDepthNode)
    bus.deliver("/sphere_info", conversions.camera_to_sphere_info(Spherical(128, 64), "base_link"))
    bus.deliver("/image_raw", picture(1))
    told = statuses(bus)  # at once, and for the image
    assert [(status.state, status.reason) for status in told] == [("NO_MAP", "")] * 2
    assert {status.remedy for status in told} == {"set `cloud`, call ~/load_cloud, or publish the topic cloud"}


def test_images_without_calibration_are_answered(room):
    bus = OfflineBus()
    bus.add(MclDepthNode, {"cloud": str(room)})
    for number in range(1, 5):
        bus.deliver("/image_raw", picture(number))
    assert {status.reason for status in statuses(bus)} == {"BAD_INFO"}


def test_while_the_map_is_made_ready_every_image_tells_how_much_of_it_is(room, monkeypatch):
    monkeypatch.setattr(clouds, "MADE_AT_ONCE", 20)
    bus = OfflineBus()
    node = bus.add(MclDepthNode, {"cloud": str(room), "camera_height": 1.2})
    bus.deliver("/sphere_info", conversions.camera_to_sphere_info(Spherical(128, 64), "base_link"))
    found = []
    while node.filter is None and len(found) < 20:
        bus.deliver("/image_raw", picture(len(found) + 1))
        found += statuses(bus)
    waiting = found[:-1]
    assert len(waiting) >= 2
    assert {(status.state, status.reason) for status in waiting} == {("SEARCHING", "NO_CONVERGENCE")}
    shares = [status.value for status in waiting]
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] < 1.0
    assert "share of the map" in waiting[0].remedy
    assert "share of the map" not in found[-1].remedy


TOPICS = {"/particle_cloud", "/heading", "/hypotheses", "/synthesized_depth"}


@pytest.mark.slow
def test_every_image_is_shown(tmp_path):
    np.save(tmp_path / "room.npy", room_points(0.08))
    bench = Bench(Eye(), tmp_path / "room.npy", bus=OfflineBus(None))
    assert isinstance(bench.node.views, Views)
    answer = bench.see(drive()[0])
    assert set(answer) & TOPICS == TOPICS
    assert sum(particle.weight for particle in answer["/particle_cloud"].particles) == pytest.approx(1.0)


LEVEL = so3.exp([0.0, 0.1, 0.0]) @ so3.exp([-0.05, 0.0, 0.0])


def test_the_parameters_hold_until_an_imu_gives_roll_and_pitch_but_not_yaw():
    bus = OfflineBus()
    attitude = Attitude(bus.add(ManagedNode).endpoints, np.degrees(-0.05), np.degrees(0.1))
    np.testing.assert_allclose(attitude.tilt, LEVEL, atol=1e-12)
    message, other = Imu(), so3.exp([0.0, -0.2, 0.0])
    q = message.orientation
    turned = SE3.from_parts(so3.exp([0.0, 0.0, 2.0]) @ other, np.zeros(3))
    q.x, q.y, q.z, q.w = (float(value) for value in turned.quaternion)
    bus.deliver("/imu", message)
    np.testing.assert_allclose(attitude.tilt, other, atol=1e-9)


def test_the_base_hangs_below_the_levelled_camera_and_is_unsure_as_that_is(rng):
    """By Monte Carlo: a camera ahead of the base and above it, unsure of its heading most of all."""
    T_map_level, T_base_level = SE3.from_planar(3.0, -2.0, 0.7), SE3.from_parts(np.eye(3), [2.0, 0.3, 1.5])
    status = Status(State.TRACKING)
    found = to_base(Estimate(status, T_map_level, np.eye(6)), T_base_level, LEVEL)
    T_map_eye = found.T_map_base @ T_base_level
    np.testing.assert_allclose(
        T_map_eye.matrix, SE3.from_parts(T_map_level.rotation @ LEVEL, T_map_level.translation).matrix
    )
    root = np.diag([0.02, 0.01, 0.005, 0.001, 0.002, 0.02])
    root[5, 1] = 0.01
    steep = so3.exp([0.0, 0.6, 0.0]) @ so3.exp([-0.4, 0.0, 0.0])
    found = to_base(Estimate(status, T_map_level, root @ root.T), T_base_level, steep)
    T_level_base = SE3.from_parts(steep, np.zeros(3)) @ T_base_level.inverse()
    drawn = T_map_level @ SE3.exp(rng.normal(size=(5_000, 6)) @ root.T) @ T_level_base
    expected = np.cov((found.T_map_base.inverse() @ drawn).log().T)
    sigma = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(found.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.1)
    assert to_base(Estimate(status), T_base_level, LEVEL).T_map_base is None
