"""`sphere_nav refine-camera`: a drive tells the lens, where the camera sits, and where its depth camera does."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_odometry
from sphere_nav.ros.maps.reader import save_map
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.refine_camera import mounting_by_odometry, mounting_lines, mounting_values
from worlds.localizer import STEP_NS, at, make_map
from worlds.recordings import FRAME, stamp, stereo, write_bag
from worlds.room import optical, sharp_room, wide_room

START_NS = 1_000_000_000
CAMERA = Pinhole(200, 150, 140.0, 140.5, 101.0, 73.0, (-0.06, 0.01, 0.0, 0.0))
GUESS = replace(CAMERA, fx=147.0, fy=147.0, cx=99.5, cy=74.5, distortion=())  # 5 % off
READOUT_S = 0.03
NUM_IMAGES = 16
TUNED = ["--set", "acceptance.min_pixels=200", "--set", "alignment.num_levels=4", "--images", "8"]


def pose(t):
    """A camera that sways, nods and rolls while it moves ahead."""
    turn = SE3.exp([0.0, 0.0, 0.0, 0.12 * np.sin(5 * t), 0.2 * np.sin(4 * t + 1), 0.1 * np.sin(6 * t + 2)])
    return at(-1.6 + 0.8 * t, 0.2 * np.sin(2 * t), 0.5 * t) @ turn


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder, room = tmp_path_factory.mktemp("refine"), wide_room()
    places = [SE3.from_planar(x, 0.0, 0.0) for x in (-1.8, -1.0)]
    save_map(folder / "map", make_map(room, places, Spherical(1024, 512)).graph)
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/camera_info", CameraInfo, qos.STATE)
        bag.add_topic("/image_raw", Image, qos.STATE)
        rng = np.random.default_rng(3)
        for k in range(NUM_IMAGES):
            stamp, t = START_NS + k * STEP_NS, k * STEP_NS * 1e-9
            twist = (pose(t - 1e-3).inverse() @ pose(t + 1e-3)).log() * READOUT_S / 2e-3
            gray = room.render_rolling(CAMERA, pose(t), twist) + rng.normal(0, 2.0, (CAMERA.height, CAMERA.width))
            image = np.clip(np.rint(gray), 1, 255).astype(np.uint8)
            bag.write("/camera_info", camera_to_info(GUESS, stamp, "optical"), stamp)
            bag.write("/image_raw", array_to_image(image, stamp, "optical", "mono8"), stamp)
    return folder


@pytest.mark.slow
def test_a_guess_becomes_a_calibration(recorded, tmp_path, capsys):
    output = tmp_path / "camera.yaml"
    assert main(["refine-camera", str(recorded / "map"), str(recorded / "bag"), "-o", str(output), *TUNED]) == 0
    found = yaml.safe_load(output.read_text())
    fx, _, cx, _, fy, cy, *_ = found["camera_matrix"]["data"]
    assert (fx, fy) == pytest.approx((CAMERA.fx, CAMERA.fy), rel=0.003)
    assert (cx, cy) == pytest.approx((CAMERA.cx, CAMERA.cy), abs=0.5)
    assert found["readout"] == pytest.approx(READOUT_S, rel=0.1)
    assert set(found["standard_deviations"]) == {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "readout"}
    printed = capsys.readouterr().out
    assert "NOT OBSERVED" not in printed
    assert "no mounting: the bag has no odometry" in printed


PERIOD_NS = 50_000_000
T_BASE_CAMERA = SE3.from_angles(0.02, 0.1, 0.4, [0.6, -0.1, 1.1])


def drive(folder, count):
    """A bag with the odometry of a vehicle that weaves, and its camera's poses between those messages."""
    T_odom_base, poses = SE3.identity(), []
    with BagWriter(folder) as bag:
        bag.add_topic("/wheels", Odometry, qos.SENSOR)
        for k in range(count):
            step = SE3.exp([0.04, 0.0, 0.0, 0.0, 0.0, 0.02 * np.sin(0.05 * k)])
            stamp = 1_000_000_000 + k * PERIOD_NS
            message = se3_to_odometry(T_odom_base, np.zeros((6, 6)), stamp, ("odom", "base_link"))
            bag.write("/wheels", message, stamp)
            between = T_odom_base @ SE3.exp(0.5 * step.log())
            poses.append(SE3.from_planar(5.0, 1.0, 0.7) @ between @ T_BASE_CAMERA @ T_BODY_OPTICAL)
            T_odom_base = T_odom_base @ step
    stamps = 1_000_000_000 + PERIOD_NS // 2 + PERIOD_NS * np.arange(count)
    return Trajectory(stamps, SE3(np.stack([pose.matrix for pose in poses])))


def options(folder, mounting=""):
    return SimpleNamespace(source=folder, mounting=mounting)


@pytest.mark.slow
def test_a_camera_is_mounted_where_odometry_finds_it(tmp_path):
    camera = drive(tmp_path / "bag", 400)
    found, _ = mounting_by_odometry(options(tmp_path / "bag", "0.5,0,1.1,0,0,0"), "optical", "/wheels", camera)
    assert found.unobserved == ("z",)
    assert found.values[:6] == pytest.approx([0.6, -0.1, 1.1, 0.02, 0.1, 0.4], abs=2e-3)
    assert next(line for line in mounting_lines(found) if "NOT OBSERVED" in line).startswith("z ")
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump({"camera_name": "front"} | mounting_values(found)))
    assert read_mounting(str(path)).matrix == pytest.approx(found.T_base_camera.matrix, abs=1e-9)


def test_a_drive_that_is_too_short_says_so(tmp_path):
    found, reason = mounting_by_odometry(options(tmp_path / "bag"), "optical", "/wheels", drive(tmp_path / "bag", 40))
    assert found is None
    assert reason == "expected a drive of at least 8 pieces of 1 m or 17 deg, found 1"


COLOR = Pinhole(240, 180, 190.0, 190.0, 119.5, 89.5)
ROOM = sharp_room((2.0, 1.6, 1.2), 0.2)
T_IMAGE_DEPTH = SE3.exp([-0.016, 0.006, -0.01, 0.010, -0.011, 0.009])  # 20 mm, 1 deg
NUM_FRAMES = 18


def way(number):
    """A camera that sways while it moves ahead and turns."""
    t = 0.5 * number
    turn = [0.0, 0.0, 0.0, 0.08 * np.sin(1.3 * t), 0.06 * np.sin(1.7 * t + 1), 0.15 * t]
    return SE3.exp([-0.6 + 0.12 * t, 0.3 * np.sin(t), 0.25 * np.cos(1.4 * t), 0.0, 0.0, 0.0]) @ SE3.exp(turn)


def rgbd(T_image_depth, place=way):
    """Image and depth of a camera whose depth is said to be registered to the image."""

    def instant(number):
        T_room_camera = optical(place(number))
        _, range_m = ROOM.render(COLOR, T_room_camera @ T_image_depth)
        depth_m = (range_m * COLOR.unproject(pixel_grid(COLOR))[..., 2]).astype(np.float32)
        yield "camera_info", camera_to_info(COLOR, stamp(number), FRAME)
        yield "depth/image_raw", array_to_image(depth_m, stamp(number), FRAME, "32FC1")
        image = ROOM.photograph(COLOR, T_room_camera, number)
        yield "image_raw", array_to_image(image, stamp(number), FRAME, "mono8")

    return instant


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("depth")
    return {
        "wrong": write_bag(folder / "wrong", rgbd(T_IMAGE_DEPTH), numbers=range(NUM_FRAMES)),
        "still": write_bag(folder / "still", rgbd(SE3.identity(), lambda _: way(0)), numbers=range(3)),
        "stereo": write_bag(folder / "stereo", stereo, numbers=range(2)),
    }


def call(*words):
    return main([str(word) for word in words])


@pytest.mark.slow
def test_a_wrong_pose_is_named_found_and_mapped_with(bags, tmp_path, capsys):
    assert call("map", bags["wrong"], "-o", tmp_path / "bent") == 0
    assert "depth camera: this drive places it elsewhere" in capsys.readouterr().out
    output = tmp_path / "depth.yaml"
    assert call("refine-camera", bags["wrong"], "-o", output) == 0
    assert "NOT OBSERVED" not in capsys.readouterr().out
    off = read_mounting(str(output), "depth_pose").distance(T_IMAGE_DEPTH)
    assert off[0] < 0.01  # deviations are 2 to 5 mm, 0.05 deg
    assert off[1] < np.radians(0.2)
    assert set(yaml.safe_load(output.read_text())["standard_deviations"]) == {"x", "y", "z", "roll", "pitch", "yaw"}
    assert call("map", bags["wrong"], "-o", tmp_path / "straight", "--set", f"depth_pose={output}") == 0
    assert "depth camera" not in capsys.readouterr().out
