"""The node dense_localizer with several cameras, a fisheye, a whole sphere: one pose of the base."""

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    camera_to_sphere_info,
    pose_with_covariance_to_se3,
    se3_to_transform,
    stamp_ns,
)
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.localizer import FISHEYE, PINHOLE, SMALL_IMAGES, STEP_NS, WIDE_ROOM, drive, wide_map

START_NS = 1_000_000_000
CAMERAS = {"front": PINHOLE, "back": FISHEYE}
MOUNTS = {  # in body axes: ahead and to the left; back
    "front": SE3.from_parts(SE3.from_planar(0, 0, 0.3).rotation, [0.5, 0.1, 0.2]),
    "back": SE3.from_parts(SE3.from_planar(0, 0, 2.9).rotation, [-0.4, 0.0, 0.1]),
}
MAX_M, MAX_RAD = 0.015, 0.008  # as one camera in test/dense_localizer/test_localizer.py
NUM = 8
BASE = [pose @ T_BODY_OPTICAL.inverse() for pose in drive(NUM)]  # poses of the base
RIG = SMALL_IMAGES | {"rig.cameras": "front,back"}


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "rig.yaml"
    cameras = [RigCamera(name, CAMERAS[name], mount @ T_BODY_OPTICAL) for name, mount in MOUNTS.items()]
    write_rig(path, Rig(tuple(cameras)))
    return path


@pytest.fixture(scope="module")
def map_path(rig_file, pictures, tmp_path_factory):
    """A map, in which cameras were localised before: what that loads is charged to no test."""
    details, graph = MapDetails(rig=rig_file.read_text()), wide_map(-2.0, -1.0, 0.0).graph
    path = save_map(tmp_path_factory.mktemp("maps") / "room", graph, details)
    bench = Bench(path)
    bench.see(pictures, 0)
    return path


@pytest.fixture(scope="module")
def pictures():
    return {
        name: [
            WIDE_ROOM.photograph(camera, T @ MOUNTS[name] @ T_BODY_OPTICAL, 10 * k + len(name))
            for k, T in enumerate(BASE)
        ]
        for name, camera in CAMERAS.items()
    }


def statics():
    mounts = [se3_to_transform(T @ T_BODY_OPTICAL, START_NS, "base_link", name) for name, T in MOUNTS.items()]
    return TFMessage(transforms=mounts)


class Bench:
    def __init__(self, map_path, values=RIG, *, has_tf=True, infos=("front", "back")):
        self.bus = OfflineBus()
        self.node = self.bus.add(DenseLocalizerNode, {"map": str(map_path)} | values)
        self.now = START_NS
        if has_tf:
            self.send("/tf_static", statics())
        for name in infos:
            self.send(f"/cameras/{name}/camera_info", camera_to_info(CAMERAS[name], self.now, name))

    def send(self, topic, message):
        self.bus.publish(topic, message)
        return [record for record in self.bus.settle() if record.topic != topic]

    def see(self, pictures, k, names=("front", "back")):
        self.now = START_NS + (k + 1) * STEP_NS
        said = list(self.bus.advance(self.now))
        for name in names:
            image = array_to_image(pictures[name][k], self.now, name, "mono8")
            said += self.send(f"/cameras/{name}/image_raw", image)
        return {record.topic: record.message for record in said}


def assert_near(answer, truth):
    T_map_base, covariance = pose_with_covariance_to_se3(answer["/pose"], "map")
    assert np.all(np.less(T_map_base.distance(truth), (MAX_M, MAX_RAD)))
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


def test_two_cameras_give_one_pose_of_the_base_at_each_instant(map_path, pictures):
    bench = Bench(map_path)
    answers = [bench.see(pictures, k) for k in range(NUM)]
    assert [answer["/status"].state for answer in answers] == ["PROBATION"] + ["TRACKING"] * (NUM - 1)
    for k in range(1, NUM):
        assert_near(answers[k], BASE[k])
        assert stamp_ns(answers[k]["/pose"]) == START_NS + (k + 1) * STEP_NS
        assert (answers[k]["/pose"].header.frame_id, answers[k]["/odometry"].child_frame_id) == ("map", "base_link")


def test_a_rig_of_the_map_takes_the_place_of_camera_info_and_tf(map_path, pictures):
    values = SMALL_IMAGES | {"rig.calibration": "map", "mounting": "0,0,0,0,0,0"}
    bench = Bench(map_path, values, has_tf=False, infos=())
    answers = [bench.see(pictures, k) for k in range(5)]
    assert answers[-1]["/status"].state == "TRACKING"
    assert_near(answers[-1], BASE[4])


def test_a_camera_that_fails_is_named_and_the_other_goes_on(map_path, pictures):
    bench = Bench(map_path)
    for k in range(5):
        bench.see(pictures, k)
    said = [bench.see(pictures, k, ("front",)) for k in (5, 6, 7)]
    assert "/status" not in said[0]  # the other one is waited for until the next instant begins
    status = said[1]["/status"]
    assert (status.state, status.reason) == ("TRACKING", "GAP")
    assert "camera back" in status.remedy
    assert bench.node.reports["camera back"][0] == 2
    assert bench.node.reports["camera front"][0] == 0


def test_where_every_camera_fails_images_are_answered_by_what_is_wrong(map_path, pictures):
    halves = {name: [image[: len(image) // 2] for image in images] for name, images in pictures.items()}
    status = Bench(map_path).see(halves, 0)["/status"]
    assert status.reason == "BAD_INFO"
    assert "camera front" in status.remedy or "camera back" in status.remedy


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"rig.cameras": "front,front"}, "expected different names"),
        ({"rig.calibration": "map", "rig.cameras": "front,side"}, "front, back"),
        ({"rig.cameras": "front", "use_depth": True}, "use_depth: expected one camera"),
    ],
)
def test_a_rig_that_cannot_be_is_refused_at_once(map_path, values, words):
    with pytest.raises((ValueError, OSError), match=words):
        Bench(map_path, SMALL_IMAGES | values, has_tf=False, infos=())


@pytest.mark.parametrize("told_by", ["sphere_info", "is_panorama"])
def test_a_whole_sphere_is_a_camera(map_path, told_by):
    camera = Spherical(256, 128)
    values = SMALL_IMAGES | {"base_frame": "", "is_panorama": told_by == "is_panorama"}
    bench = Bench(map_path, values, has_tf=False, infos=())
    if told_by == "sphere_info":
        bench.send("/sphere_info", camera_to_sphere_info(camera, "sphere"))
    for k, T_room_base in enumerate(BASE[:5]):
        bench.now = START_NS + (k + 1) * STEP_NS
        image = array_to_image(WIDE_ROOM.photograph(camera, T_room_base, k), bench.now, "sphere", "mono8")
        answer = {record.topic: record.message for record in bench.send("/image_raw", image)}
    assert answer["/status"].state == "TRACKING"
    assert_near(answer, BASE[4])
