"""Presets of camera drivers: each file is valid, known by its topics, and heard by nodes as by commands."""

from pathlib import Path

import pytest
import yaml
from rclpy.parameter import Parameter
from sensor_msgs.msg import CompressedImage, Image

from sphere_mapping.ros.intake import TOPICS
from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.drivers import INPUTS, OPTIONAL, driver_names, read_driver, topics_by_driver
from sphere_nav.ros.live import LiveShell
from sphere_nav.ros.node import ManagedNode

FILES = Path(__file__).resolve().parents[4] / "config" / "cameras"
WANTED = TOPICS | {"mono": ("image_raw", "camera_info"), "panorama": ("image_raw",)}
DEPTH_INFO = "depth/camera_info"
VENDORS = ("realsense", "zed", "oak", "kinect", "usb_cam")


@parameters
class EarParams:
    driver: str = param("", "camera driver")


class Ear(ManagedNode):
    NAME, PARAMS = "ear", EarParams

    def configure(self):
        self.heard = []
        self.add_subscription("image_raw", Image, self.heard.append, qos.SENSOR)
        self.add_subscription("image_raw/compressed", CompressedImage, self.heard.append, qos.SENSOR)
        self.add_subscription("other", Image, self.heard.append, qos.SENSOR)


def test_the_files_are_those_that_are_installed_and_all_vendors_are_there():
    assert driver_names() == sorted(path.stem for path in FILES.glob("*.yaml"))
    assert {vendor for vendor in VENDORS if any(vendor in name for name in driver_names())} == set(VENDORS)


@pytest.mark.parametrize("name", sorted(path.stem for path in FILES.glob("*.yaml")))
def test_a_file_names_what_its_job_needs(name):
    driver = read_driver(name)
    assert driver.input in INPUTS
    assert set(driver.topics) - {DEPTH_INFO, *OPTIONAL} == set(WANTED[driver.input])
    assert yaml.safe_load((FILES / f"{name}.yaml").read_text())["source"].startswith("https://")
    topics = [f"/{topic}" for topic in driver.names().values()]
    assert driver.missing(topics) == []
    assert driver.roots(topics) == [driver.root]


def test_topics_are_found_compressed_below_another_namespace_and_without_what_is_optional():
    driver = read_driver("realsense")
    have = [f"/front/{topic}" for ours, topic in driver.topics.items() if ours != "imu"]
    have[0] += "/compressed"
    assert driver.roots(have) == ["front"]
    assert driver.find(have, "front")["image_raw"] == "/front/color/image_raw/compressed"
    assert driver.missing(have[1:], "front") == ["/front/color/image_raw"]
    assert driver.roots([*have, *(topic.replace("front", "rear") for topic in have)]) == ["front", "rear"]


def test_a_file_of_ones_own_is_as_good_as_a_name(tmp_path):
    content = yaml.safe_load((FILES / "usb_cam.yaml").read_text()) | {"root": "/head/"}
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(content))
    assert topics_by_driver(str(path)) == {"image_raw": "head/image_raw", "camera_info": "head/camera_info"}
    assert topics_by_driver("") == {}


def test_a_node_hears_the_driver_unless_a_topic_is_remapped():
    bus = OfflineBus()
    bus.add(Ear, {"driver": "realsense"})
    heard = "/camera/camera/color/image_raw"
    assert set(bus.listeners) == {heard, f"{heard}/compressed", "/other"}
    bus = OfflineBus()
    bus.add(Ear, {"driver": "realsense"}, {"image_raw": "/mine"})
    assert set(bus.listeners) == {"/mine", f"{heard}/compressed", "/other"}


def test_a_live_node_hears_the_driver_in_its_namespace_unless_a_topic_is_remapped(ros):
    words = ["--ros-args", "-r", "__ns:=/car", "-r", "image_raw/compressed:=/mine"]
    shell = LiveShell(Ear, parameter_overrides=[Parameter("driver", value="realsense")], cli_args=words)
    try:
        shell.trigger_configure()
        topics = [wanted.handle.topic_name for wanted in shell.node.inputs]
        assert topics == ["/car/camera/camera/color/image_raw", "/mine", "/car/other"]
    finally:
        shell.stop()
        shell.destroy_node()
