"""What a user may get wrong: one line and status 2, a refused request, or a status; never a pose, never a crash."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import SphereInfo
from tf2_msgs.msg import TFMessage

from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_sphere_info,
    cloud_to_message,
    se3_to_odometry,
    se3_to_transform,
)
from sphere_nav_tools.cli.main import main
from worlds.mcl import SECOND, SETTINGS, T_BASE_EYE, T_ODOM_MAP, Bench, Eye, drive, room_points

CLOUDS = {
    "all_nan": (np.full((50, 3), np.nan), "expected at least one finite point, found 50 points, none finite"),
    "degrees": (room_points(0.5) * np.array([1e-5, 1e-5, 1.0]) + [8.4, 49.0, 0.0], "longitude and latitude?"),
    "plain": (room_points(0.5) * np.array([9.0, 9.0, 0.0]), "expected walls or the like above the ground"),
}


@pytest.fixture(scope="module")
def eye():
    return Eye()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The room, and what should be one; bags of a drive, and what should be one."""
    folder = tmp_path_factory.mktemp("files")
    np.save(folder / "room.npy", room_points())
    for name, (points, _) in CLOUDS.items():
        np.save(folder / f"{name}.npy", points)
    write_bag(folder / "bag")
    write_bag(folder / "no_info", info=None)
    write_bag(folder / "uncalibrated", info=CameraInfo(width=180, height=85))
    return folder


def write_bag(path, info="sphere", count=3):
    eye = Eye()
    with BagWriter(path) as bag:
        bag.add_topic("/tf_static", TFMessage, qos.TF_STATIC)
        bag.add_topic("/odom", Odometry, qos.STATE)
        bag.add_topic("/image_raw", Image, qos.STATE)
        bag.write("/tf_static", TFMessage(transforms=[se3_to_transform(T_BASE_EYE, 1, "base_link", "eye")]), SECOND)
        if info == "sphere":
            bag.add_topic("/sphere_info", SphereInfo, qos.STATE)
            bag.write("/sphere_info", camera_to_sphere_info(eye.camera, "eye"), SECOND)
        elif info is not None:
            info.header.frame_id = "eye"
            bag.add_topic("/camera_info", CameraInfo, qos.STATE)
            bag.write("/camera_info", info, SECOND)
        for number, pose in enumerate(drive(count), 1):
            stamp = number * SECOND
            odometry = se3_to_odometry(T_ODOM_MAP @ pose, 1e-4 * np.eye(6), stamp, ("odom", "base_link"))
            bag.write("/odom", odometry, stamp)
            bag.write("/image_raw", array_to_image(eye.picture(pose), stamp, "eye", "mono8"), stamp)


def refusal(capfd, tmp_path, *words):
    """Run `sphere_nav mcl`; return its one line, after checking that there is no other, and nothing written."""
    output = tmp_path / "poses.tum"
    tuned = [word for name, value in SETTINGS.items() for word in ("--set", f"{name}={value}")]
    capfd.readouterr()
    status = main(["mcl", *map(str, words), "-o", str(output), *tuned])
    out, err = capfd.readouterr()
    lines = [line for line in err.splitlines() if line.strip() and "%|" not in line and "msg/s" not in line]
    assert status == 2, (out, err)
    assert len(lines) == 1, err
    assert lines[0].startswith("sphere_nav mcl: ")
    assert not output.exists()
    return lines[0]


# --- the command
@pytest.mark.parametrize("name", ["all_nan", "degrees"])
def test_the_command_refuses_a_cloud_that_is_none(files, tmp_path, capfd, name):
    line = refusal(capfd, tmp_path, files / f"{name}.npy", files / "bag")
    assert f"{name}.npy" in line
    assert CLOUDS[name][1] in line


@pytest.mark.parametrize(
    ("bag", "expected"), [("no_info", "expected one topic with camera_info"), ("uncalibrated", "focal length 0")]
)
def test_the_command_refuses_a_recording_without_calibration(files, tmp_path, capfd, bag, expected):
    line = refusal(capfd, tmp_path, files / "room.npy", files / bag, "--set", "max_waiting=1")
    assert expected in line


# --- the node


def test_a_cloud_by_topic_without_coordinates_or_with_a_point_far_outside_is_refused(eye):
    bench, message = Bench(eye), cloud_to_message(room_points(0.5), SECOND, "map")
    message.fields[2].name = "intensity"
    stray = cloud_to_message(np.vstack([room_points(0.5), [0.0, 5e4, 0.0]]), SECOND, "map")
    for sent, said in ((message, "field of numbers 'z'"), (stray, "expected one place, found 99.9%")):
        bench.send("/cloud", sent)
        assert bench.node.clouds.geometry is None
        assert said in next(item.last_refusal for item in bench.node.inputs if item.topic == "cloud")


@pytest.mark.slow
def test_odometry_that_stops_degrades_and_is_named(eye, files):
    bench, poses = Bench(eye, files / "room.npy"), drive()
    assert bench.follow_from(poses[:10])[-1]["/status"].state == "TRACKING"
    for pose in poses[10:]:
        said = bench.see(pose, has_odometry=False)
        assert (said["/status"].state, said["/status"].reason) == ("DEGRADED", "ODOM_STALE")
