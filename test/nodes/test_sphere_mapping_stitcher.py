"""The node sphere_stitcher: six cameras in, spheres out; late, missing and frozen cameras, depth, LiDAR."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import array_to_image, cloud_to_message, header, message_to_sphere, se3_to_transform
from worlds.rig import RADIUS, seen, truth, vertical_rig

MS = 1_000_000
RIG = vertical_rig()
IMAGES = [{part.name: seen(part, phase=0.02 * k) for part in RIG.cameras} for k in range(5)]
SMALL = {"stitch.width": 256, "sync.deadline_s": 0.2}


@pytest.fixture
def rig_path(tmp_path):
    write_rig(tmp_path / "rig.yaml", RIG)
    return str(tmp_path / "rig.yaml")


class Bench:
    def __init__(self, **values):
        self.bus = OfflineBus()
        self.node = self.bus.add(SphereStitcher, SMALL | values)
        self.spheres, self.static = [], []
        self.settle()

    def settle(self):
        for item in self.bus.settle():
            if item.topic == "/sphere":
                self.spheres.append(item.message)
            elif item.topic == "/tf_static":
                self.static += item.message.transforms

    def send(self, topic, message):
        self.bus.publish("/" + topic.lstrip("/"), message)
        self.settle()

    def pass_time(self, stamp):
        for item in self.bus.advance(stamp):
            if item.topic == "/sphere":
                self.spheres.append(item.message)

    def shoot(self, stamp, images, without=(), encode=None):
        """Let time pass until the stamp, and send what the cameras see."""
        self.pass_time(stamp)
        for name, image in images.items():
            if name in without:
                continue
            if encode is None:
                self.send(f"cameras/{name}/image_raw", array_to_image(image, stamp, f"{name}_optical", "mono8"))
            else:
                data = cv2.imencode(encode, image)[1].tobytes()
                message = CompressedImage(header=header(stamp, f"{name}_optical"), format=encode[1:], data=data)
                self.send(f"cameras/{name}/image_raw/compressed", message)

    def problems(self):
        return {name: text for name, (level, text, _) in self.node.reports.items() if level}

    def refusals(self):
        return "; ".join(wanted.last_refusal for wanted in self.node.inputs if wanted.num_refused)


def check_content(node, sphere):
    """The sphere shows the scene of a moment, at its range, within 45 degrees of the horizon."""
    levels, range_m = truth(node.stitcher)
    middle = np.abs(np.arange(128) - 64) < 32
    error = sphere.image.astype(float) - levels
    assert np.sqrt(np.mean(error[middle] ** 2)) < 6  # two interpolations of a texture of 20 px period
    known = sphere.measured & middle[:, None]
    assert known.sum() > 0.7 * middle.sum() * 256
    assert np.median(np.abs(sphere.range_m / range_m - 1)[known]) < 0.03


@pytest.mark.slow
def test_six_cameras_become_a_sphere_of_what_they_see_once_the_rig_is_told(rig_path):
    bench = Bench()
    bench.shoot(500 * MS, IMAGES[0])
    assert bench.spheres == []
    bench.send("rig_description", String(data="cameras: []"))
    assert "rig_description: " in bench.refusals()
    bench.send("rig_description", String(data=Path(rig_path).read_text()))
    bench.shoot(1000 * MS, IMAGES[0])
    [message] = bench.spheres
    assert message.header.frame_id == "rig_sphere_link"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 0)
    check_content(bench.node, message_to_sphere(message))
    [transform] = bench.static
    assert (transform.header.frame_id, transform.child_frame_id) == ("rig_link", "rig_sphere_link")
    assert transform.transform.translation.z == pytest.approx(0.15)
    assert bench.problems() == {}


@pytest.mark.slow
def test_a_missing_camera_leaves_a_wedge_and_is_named(rig_path):
    bench = Bench(rig=rig_path, transport="compressed")
    bench.shoot(900 * MS, IMAGES[0], encode=".jpg")
    check_content(bench.node, message_to_sphere(bench.spheres.pop()))
    bench.shoot(1000 * MS, IMAGES[0], without=("top_left", "bottom_left"), encode=".jpg")
    assert bench.spheres == []  # they may still come
    bench.pass_time(1300 * MS)
    [message] = bench.spheres
    sphere = message_to_sphere(message)
    hole = sphere.image == 0
    assert 0.01 < hole.mean() < 0.5  # its neighbours see most of its part, too
    assert np.isnan(sphere.range_m[hole]).all()
    _, u = np.nonzero(hole)
    azimuth = (0.5 - (u + 0.5) / 256) * 2 * np.pi
    assert np.median(azimuth) == pytest.approx(2.1, abs=0.3)  # on the left, where they look
    assert "no image within" in bench.problems()["camera top_left"]
    assert "no image within" in bench.problems()["camera bottom_left"]


def test_images_of_another_size_or_lens_are_refused_by_name(rig_path):
    bench = Bench(rig=rig_path)
    bench.send("cameras/top_front/image_raw", array_to_image(np.ones((8, 8), np.uint8), MS, "x", "mono8"))
    assert "top_front: image size: expected 160 x 160 uint8, grey or RGB, found 8 x 8" in bench.refusals()
    K = [50.0, 0.0, 79.5, 0.0, 50.0, 79.5, 0.0, 0.0, 1.0]
    bench.send("cameras/top_left/camera_info", CameraInfo(width=160, height=160, k=K))
    assert "top_left: K[0]: expected 48.000 (rig file), found 50.000" in bench.refusals()
    K[0] = K[4] = 48.0
    bent = CameraInfo(width=160, height=160, k=K, distortion_model="plumb_bob", d=[-0.3, 0.05, 0.0, 0.0, 0.0])
    bench.send("cameras/top_right/camera_info", bent)
    assert "top_right: lens: expected fisheye (rig file), found pinhole whose rays differ by" in bench.refusals()


T_RIG_LIDAR = SE3.from_planar(0.4, -0.2, 1.0) @ SE3.from_parts(np.eye(3), [0.0, 0.0, 0.3])


def cloud_of_scene(bench, stamp):
    """Points on the sphere of texture as a LiDAR on the rig gives them."""
    rays = np.random.default_rng(2).normal(size=(20000, 3))
    points = RADIUS * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return cloud_to_message(T_RIG_LIDAR.inverse().apply(points).astype(np.float32), stamp, "lidar")


@pytest.mark.parametrize("way", ["tf", "mount"])
def test_a_lidar_is_placed_by_tf_or_by_its_mount(rig_path, way):
    values = {"cloud.mounting": "0.4,-0.2,0.3,0,0,1.0"} if way == "mount" else {}
    bench = Bench(rig=rig_path, has_cloud=True, **{"stitch.range": "none"}, **values)
    if way == "tf":
        told = [
            se3_to_transform(SE3.from_planar(1.0, 0.0, 0.0), MS, "base_link", "rig_link"),
            se3_to_transform(SE3.from_planar(1.0, 0.0, 0.0) @ T_RIG_LIDAR, MS, "base_link", "lidar"),
        ]
        bench.send("/tf_static", TFMessage(transforms=told))
    bench.shoot(1000 * MS, IMAGES[0])
    assert bench.spheres == []  # a cloud of that time or later may still come
    bench.send("points", cloud_of_scene(bench, 1010 * MS))
    sphere = message_to_sphere(bench.spheres[0])
    _, range_m = truth(bench.node.stitcher)
    assert sphere.measured.mean() > 0.9
    # of nine pixels that a point covers the nearest counts: the angle of a pixel and a half, 0.04 rad
    assert np.median(np.abs(sphere.range_m / range_m - 1)[sphere.measured]) < 0.005
