"""`sphere_nav mcl`: panoramas of a furnished room against its bare walls, offline, from nowhere."""

import json

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_sphere_info, se3_to_odometry, se3_to_transform
from sphere_nav_tools.cli.main import main
from worlds.mcl import SECOND, SETTINGS, T_BASE_EYE, T_ODOM_MAP, Eye, drive, room_points

POSES = drive()
TUNED = [word for name, value in SETTINGS.items() for word in ("--set", f"{name}={value}")]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder, eye = tmp_path_factory.mktemp("mcl"), Eye()
    np.save(folder / "room.npy", room_points())
    with BagWriter(folder / "bag") as bag:
        mount = se3_to_transform(T_BASE_EYE, SECOND, "base_link", "eye")
        bag.write("/tf_static", TFMessage(transforms=[mount]), SECOND)
        for number, pose in enumerate(POSES, 1):
            stamp = number * SECOND
            odometry = se3_to_odometry(T_ODOM_MAP @ pose, 1e-4 * np.eye(6), stamp, ("odom", "base_link"))
            bag.write("/sphere_info", camera_to_sphere_info(eye.camera, "eye"), stamp)
            bag.write("/odom", odometry, stamp)
            bag.write("/image_raw", array_to_image(eye.picture(pose), stamp, "eye", "mono8"), stamp)
    return folder


def locate(folder, output, *words) -> int:
    start = ",".join(f"{value:.3f}" for value in (*POSES[0].translation, 0.0, 0.0, 0.0, 1.0))
    words = [f"--initial-pose={start}", *TUNED, *map(str, words)]
    return main(["mcl", str(folder / "room.npy"), str(folder / "bag"), "-o", str(output), *words])


@pytest.mark.slow
def test_a_base_is_found_from_panoramas_in_bare_walls(recorded, tmp_path, capsys):
    assert locate(recorded, tmp_path / "poses.tum", "--json", tmp_path / "s.json", "--bag", tmp_path / "out") == 0
    found = read_tum(tmp_path / "poses.tum")
    assert len(found) >= 3
    for stamp, pose in zip(found.stamps_ns, found.T_map_body, strict=True):
        distance, angle = pose.distance(POSES[int(stamp) // SECOND - 1])
        assert distance < 0.4  # the cells of the cache are 0.35 m wide
        assert angle < np.radians(8)  # headings are compared every 10 degrees
    summary = json.loads((tmp_path / "s.json").read_text())
    assert (summary["images"], summary["poses"]) == (len(POSES), len(found))
    assert f"{len(POSES)} images" in capsys.readouterr().out
    with BagReader(tmp_path / "out") as bag:
        assert bag.topics["/status"].count >= len(POSES)  # silence is told between images, too
        assert bag.topics["/tf"].count >= bag.topics["/pose"].count == len(found)  # told at a pace of its own
