"""`sphere_nav localize`: a bag against a map, offline."""

import json

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros import qos
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.localizing import Summary
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, drive, make_map
from worlds.room import wide_room

START_NS = 1_000_000_000
NUM_IMAGES = 8
TUNED = [word for name, value in SMALL_IMAGES.items() for word in ("--set", f"{name}={value}")]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A map of the room and a bag of a drive through it."""
    folder, room = tmp_path_factory.mktemp("localize"), wide_room()
    sphere_map = make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0)])
    save_map(folder / "map", sphere_map.graph)
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/tf_static", TFMessage, qos.TF_STATIC)
        bag.add_topic("/camera_info", CameraInfo, qos.STATE)
        bag.add_topic("/image_raw", Image, qos.STATE)
        transform = se3_to_transform(T_BODY_OPTICAL, START_NS, "base_link", "optical")
        bag.write("/tf_static", TFMessage(transforms=[transform]), START_NS)
        for k, pose in enumerate(drive(NUM_IMAGES)):
            stamp = START_NS + k * STEP_NS
            bag.write("/camera_info", camera_to_info(PINHOLE, stamp, "optical"), stamp)
            image = room.photograph(PINHOLE, pose, k)
            bag.write("/image_raw", array_to_image(image, stamp, "optical", "mono8"), stamp)
    return folder


def localize(recorded, output, *words) -> int:
    return main(["localize", str(recorded / "map"), str(recorded / "bag"), "-o", str(output), *TUNED, *map(str, words)])


@pytest.mark.slow
def test_trusted_poses_of_the_base_are_written_with_a_summary(recorded, tmp_path, capsys):
    assert localize(recorded, tmp_path / "poses.tum", "--json", tmp_path / "s.json", "--bag", tmp_path / "out") == 0
    found = read_tum(tmp_path / "poses.tum")
    assert list(found.stamps_ns) == [START_NS + k * STEP_NS for k in range(3, NUM_IMAGES)]  # four images of probation
    assert found.covariances is not None
    for k, pose in enumerate(drive(NUM_IMAGES)[3:]):
        assert found.T_map_body[k].distance(pose @ T_BODY_OPTICAL.inverse())[0] < 0.015  # as in tracking
    summary = json.loads((tmp_path / "s.json").read_text())
    assert (summary["images"], summary["poses"]) == (NUM_IMAGES, NUM_IMAGES - 3)
    assert summary["states"] == {"PROBATION": 3, "TRACKING": NUM_IMAGES - 3}
    assert summary["milliseconds"]["p99"] >= summary["milliseconds"]["median"] > 0
    assert "8 images, 5 poses" in capsys.readouterr().out
    with BagReader(tmp_path / "out") as bag:
        counts = {topic: found.count for topic, found in bag.topics.items()}
        assert counts == {"/pose": 5, "/odometry": 5, "/status": NUM_IMAGES, "/tf": 5}
        first = next(bag.messages(["/pose"])).message
        assert isinstance(first, PoseWithCovarianceStamped)


def test_a_summary_of_nothing_is_possible():
    result = Summary().result()
    assert result["images"] == 0
    assert np.isfinite(result["milliseconds"]["median"])
