"""What a user may get wrong: one line and status 2, a refused request, or a status; never a pose, never a crash."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import SphereInfo
from sphere_nav_msgs.srv import LoadCloud
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
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
    "empty": (np.empty((0, 3)), "expected at least one finite point, found 0 points"),
    "all_nan": (np.full((50, 3), np.nan), "expected at least one finite point, found 50 points, none finite"),
    "flat": (np.zeros((50, 2)), "expected numbers of shape (N, 3)"),
    "off_the_globe": (
        room_points(0.5) + np.array([4.5e8, 0.0, 0.0]),
        "expected coordinates within 100000 m of the origin",
    ),
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
    np.save(folder / "millimetres.npy", 20_000.0 * room_points(0.5))
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
@pytest.mark.parametrize("name", CLOUDS)
def test_the_command_refuses_a_cloud_that_is_none(files, tmp_path, capfd, name):
    line = refusal(capfd, tmp_path, files / f"{name}.npy", files / "bag")
    assert f"{name}.npy" in line
    assert CLOUDS[name][1] in line


def test_the_command_refuses_millimeters(files, tmp_path, capfd):
    line = refusal(capfd, tmp_path, files / "millimetres.npy", files / "bag")
    assert "expected metres, found an extent of 160000 m" in line
    assert "this looks like millimetres" in line


@pytest.mark.parametrize(
    ("bag", "expected"),
    [("no_info", "expected one topic with camera_info"), ("uncalibrated", "focal length 0"), ("absent", "absent")],
)
def test_the_command_refuses_a_recording_without_calibration(files, tmp_path, capfd, bag, expected):
    line = refusal(capfd, tmp_path, files / "room.npy", files / bag, "--set", "max_waiting=1")
    assert expected in line


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("heading_step_deg=7", "alpha step: expected a divisor of 360 deg, found 7 deg"),
        ("heading_step_deg=7.2", "alpha step: expected a multiple of a column, 2 deg, found 7.2 deg"),
        ("heading_step_deg=0", "heading_step_deg"),
        ("area.limits=1,2,3", "area.limits: expected x0,y0,x1,y1"),
        ("area.limits=500,500,600,600", "area: expected"),
    ],
)
def test_the_command_refuses_settings_that_make_no_sense(files, tmp_path, capfd, setting, expected):
    assert expected in refusal(capfd, tmp_path, files / "room.npy", files / "bag", "--set", setting)


# --- the node
@pytest.mark.parametrize("name", CLOUDS)
def test_a_call_for_a_cloud_that_is_none_is_refused(eye, files, name, caplog):
    bench = Bench(eye, files / "room.npy")
    before = bench.node.clouds.geometry
    answer = bench.node.shell.call("load_cloud", LoadCloud.Request(path=str(files / f"{name}.npy")))
    assert not answer.success
    assert CLOUDS[name][1] in caplog.text
    assert bench.node.clouds.geometry is before


def test_a_cloud_in_millimeters_changes_nothing(eye, files, caplog):
    bench = Bench(eye, files / "room.npy")
    before = bench.node.clouds.geometry
    answer = bench.node.shell.call("load_cloud", LoadCloud.Request(path=str(files / "millimetres.npy")))
    assert not answer.success
    assert "this looks like millimetres" in caplog.text
    assert bench.node.clouds.geometry is before


@pytest.mark.slow
def test_points_that_are_no_numbers_are_left_out(eye, files, caplog):
    points = room_points()
    points[::50, 1] = np.nan
    points[7] = np.inf
    np.save(files / "holes.npy", points)
    bench = Bench(eye, files / "holes.npy")
    assert "points are not finite and are left out" in caplog.text
    assert bench.follow_from(drive())[-1]["/status"].state == "TRACKING"
    assert len(bench.node.clouds.geometry) < len(points)


def test_a_cloud_by_topic_without_coordinates_is_refused(eye):
    bench, message = Bench(eye), cloud_to_message(room_points(0.5), SECOND, "map")
    message.fields[2].name = "intensity"
    bench.send("/cloud", message)
    assert bench.node.clouds.geometry is None
    assert "field of numbers 'z'" in next(item.last_refusal for item in bench.node.inputs if item.topic == "cloud")


@pytest.mark.parametrize("step", [7.0, 7.2, 50.0])
def test_a_step_of_headings_that_does_not_fit_refuses_to_start(eye, step):
    with pytest.raises(ValueError, match="alpha step: expected a"):
        Bench(eye, heading_step_deg=step)


def test_images_without_calibration_are_answered_by_the_reason(eye, files):
    bench = Bench(eye, files / "room.npy", is_calibrated=False, max_waiting=1)
    status = bench.follow(drive(3))[-1]["/status"]
    assert (status.state, status.reason) == ("SEARCHING", "BAD_INFO")
    info = CameraInfo(width=180, height=85)
    info.header.frame_id = "eye"
    bench.send("/camera_info", info)
    status = bench.see(drive(4)[-1])["/status"]
    assert status.reason == "BAD_INFO"
    assert "focal length 0" in status.remedy


@pytest.mark.slow
def test_odometry_that_stops_degrades_and_is_named(eye, files):
    bench, poses = Bench(eye, files / "room.npy"), drive()
    assert bench.follow_from(poses[:10])[-1]["/status"].state == "TRACKING"
    for pose in poses[10:]:
        said = bench.see(pose, has_odometry=False)
        assert (said["/status"].state, said["/status"].reason) == ("DEGRADED", "ODOM_STALE")


@pytest.mark.slow
def test_odometry_that_leaps_is_not_believed(eye, files):
    bench, poses = Bench(eye, files / "room.npy"), drive()
    bench.follow_from(poses[:10])
    leap = SE3.from_planar(60.0, 0.0, 0.0)
    said = bench.see(poses[10], T_odom_base=leap @ T_ODOM_MAP @ poses[10])
    assert (said["/status"].state, said["/status"].reason) == ("DEGRADED", "JUMP_REJECTED")
    spread = bench.node.filter.particles.poses[:, :2] - (poses[10] @ T_BASE_EYE).translation[:2]
    assert np.median(np.linalg.norm(spread, axis=1)) < 3.0  # they did not leap 60 m along
