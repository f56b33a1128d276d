"""The node dense_localizer: every image answered, frames and covariance, refusals and calls on an offline bus; DDS."""

from types import SimpleNamespace

import numpy as np
import pytest
from sphere_nav_msgs.srv import LoadMap, Relocalize
from tf2_msgs.msg import TFMessage

from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    odometry_to_se3,
    pose_with_covariance_to_se3,
    se3_to_odometry,
    se3_to_pose_with_covariance,
    se3_to_transform,
    stamp_ns,
    transform_to_se3,
)
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, WIDE_ROOM, drive, picture, wide_map

START_NS = 1_000_000_000
# The camera looks 0.1 rad to the left, half a metre before the base and 0.2 m above it.
T_BASE_CAMERA = SE3.from_parts(SE3.from_planar(0, 0, 0.1).rotation, [0.5, 0.0, 0.2]) @ T_BODY_OPTICAL
OPTICAL = "camera_optical"
MAX_M = 0.015  # as in test/dense_localizer/test_localizer.py


@pytest.fixture(scope="module")
def pictures():
    return [picture(number) for number in range(12)]


@pytest.fixture(scope="module")
def map_path(pictures, tmp_path_factory):
    """A map, in which a camera was localised before: what that loads is charged to no test."""
    path = save_map(tmp_path_factory.mktemp("maps") / "room", wide_map(-2.0, -1.0, 0.0, 1.0).graph)
    Bench(path).follow(pictures[:2])
    return path


class Bench:
    def __init__(self, map_path="", **values):
        self.bus = OfflineBus()
        given = {name.replace("__", "."): value for name, value in values.items()}
        self.node = self.bus.add(DenseLocalizerNode, {"map": str(map_path)} | SMALL_IMAGES | given)
        self.now = START_NS
        mount = se3_to_transform(T_BASE_CAMERA, self.now, "base_link", OPTICAL)
        self.send("/tf_static", TFMessage(transforms=[mount]))
        self.send("/camera_info", camera_to_info(PINHOLE, self.now, OPTICAL))

    def send(self, topic, message):
        self.bus.publish(topic, message)
        return [record for record in self.bus.settle() if record.topic != topic]

    def see(self, picture):
        self.now += STEP_NS
        said = list(self.bus.advance(self.now))
        said += self.send("/image_raw", array_to_image(picture, self.now, OPTICAL, "mono8"))
        return {record.topic: record.message for record in said}

    def follow(self, pictures):
        return [self.see(picture) for picture in pictures]


def test_a_drive_gives_pose_odometry_transform_and_status(map_path, pictures):
    bench = Bench(map_path)
    answers = bench.follow(pictures)
    for answer in answers[:1]:  # probation
        assert set(answer) == {"/status", "/residual"}
        assert answer["/status"].state == "PROBATION"
    for k, answer in enumerate(answers[1:], start=1):
        assert set(answer) == {"/pose", "/odometry", "/tf", "/status", "/residual"}
        assert answer["/status"].state == "TRACKING"
        stamp = START_NS + (k + 1) * STEP_NS
        assert {stamp_ns(answer[topic]) for topic in ("/pose", "/odometry", "/status")} == {stamp}
        assert (answer["/pose"].header.frame_id, answer["/odometry"].child_frame_id) == ("map", "base_link")
        T_map_base, covariance = pose_with_covariance_to_se3(answer["/pose"], "map")
        distance, _ = T_map_base.distance(drive(12)[k] @ T_BASE_CAMERA.inverse())
        assert distance < MAX_M + 0.5 * 0.008  # the lever arm turns the attitude's error into a distance
        assert np.all(np.linalg.eigvalsh(covariance) > 0)
        transform = answer["/tf"].transforms[0]
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "base_link")
        np.testing.assert_allclose(transform_to_se3(transform.transform).matrix, T_map_base.matrix, atol=1e-12)
    status = answers[-1]["/status"]
    assert status.quality > 0.5
    assert status.milliseconds > 0
    assert len(status.references) == 2
    _, twist = odometry_to_se3(answers[-1]["/odometry"])
    before, last = (pose @ T_BASE_CAMERA.inverse() for pose in drive(12)[-2:])
    expected = (before.inverse() @ last).log() / (STEP_NS * 1e-9)  # of the base and not of the camera
    np.testing.assert_allclose(twist, expected, atol=2 * MAX_M / 0.05)  # two poses err, 0.05 s apart
    assert answers[-1]["/odometry"].twist.covariance[0] > 0
    drifting, sure = (answers[-1][topic].pose.covariance[0] for topic in ("/odometry", "/pose"))
    assert drifting > sure > 0  # the drift of the map is in it


def test_wheels_carry_a_camera_beside_the_base_through_the_dark(map_path, pictures):
    bench = Bench(map_path)
    for k, pose in enumerate(drive(12)):
        T_odom_base, now = pose @ T_BASE_CAMERA.inverse(), bench.now + STEP_NS
        wheels = se3_to_odometry(T_odom_base, 1e-6 * np.eye(6), now, ("odom", "base_link"), np.zeros(6))
        bench.send("/odom", wheels)
        answer = bench.see(pictures[k] if k < 8 else np.zeros_like(pictures[k]))
    T_map_base, _ = pose_with_covariance_to_se3(answer["/pose"], "map")
    assert answer["/status"].state == "DEGRADED"
    assert np.all(np.less(T_map_base.distance(T_odom_base), (0.02, 0.02)))


@pytest.mark.parametrize(("use_depth", "state"), [(True, "TRACKING"), (False, "DEGRADED")])
def test_where_the_light_goes_out_depth_goes_on(map_path, pictures, use_depth, state):
    bench, way = Bench(map_path, use_depth=use_depth), drive(12)
    for k, pose in enumerate(way[:8]):
        depth_m = WIDE_ROOM.rgbd(PINHOLE, pose)[1]
        bench.send("/depth/image_raw", array_to_image(depth_m, bench.now + STEP_NS, OPTICAL, "32FC1"))
        answer = bench.see(pictures[k] if k < 6 else np.zeros_like(pictures[k]))
    assert (answer["/status"].state, answer["/status"].reason) == (state, "LOW_TEXTURE")
    if use_depth:
        T_map_base, _ = pose_with_covariance_to_se3(answer["/pose"], "map")
        assert T_map_base.distance(way[7] @ T_BASE_CAMERA.inverse())[0] < 0.03


def test_relocalize_answers_with_the_pose_it_found(map_path, pictures):
    bench = Bench(map_path, automatic=False)
    call = bench.node.endpoints.call
    assert "next image" in call("relocalize").message
    bench.see(pictures[0])
    answer = call("relocalize")
    assert answer.success, answer.message
    T_map_base, _ = pose_with_covariance_to_se3(answer.pose, "map")
    assert T_map_base.distance(drive(1)[0] @ T_BASE_CAMERA.inverse())[0] < 2 * MAX_M
    guess = se3_to_pose_with_covariance(SE3.from_planar(90.0, 0, 0), np.eye(6), START_NS, "map")
    refused = call("relocalize", Relocalize.Request(has_guess=True, guess=guess))
    assert not refused.success
    assert "from a key sphere" in refused.message


def test_a_drive_that_is_learnt_is_complete_once_another_map_is_loaded(map_path, monkeypatch):
    ended = []
    kept = SimpleNamespace(close=lambda: ended.append("drive"))
    monkeypatch.setattr("dense_localizer.ros.node.DriveRecorder", lambda *_, **how: kept)
    bench = Bench(map_path, learn=True)
    bench.node.endpoints.call("load_map", LoadMap.Request(path=str(map_path)))
    assert ended == ["drive"]


def test_another_map_is_loaded_and_a_bad_one_leaves_the_present_in_force(map_path, pictures, tmp_path):
    bench = Bench()
    call = bench.node.endpoints.call
    answer = call("load_map", LoadMap.Request(path=str(map_path)))
    assert answer.success, answer.message
    assert answer.num_spheres == 4
    status = bench.follow(pictures[:5])[-1]["/status"]
    assert (status.state, status.map_id) == ("TRACKING", answer.map_id)
    refused = call("load_map", LoadMap.Request(path=str(tmp_path / "none")))
    assert not refused.success
    assert "none" in refused.message
    assert bench.see(pictures[5])["/status"].state == "TRACKING"
    with pytest.raises((ValueError, OSError), match="none"):
        Bench(tmp_path / "none")
