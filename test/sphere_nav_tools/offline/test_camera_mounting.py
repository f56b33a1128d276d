"""`refine-camera` tells where the camera sits, by the odometry of the bag."""

from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from nav_msgs.msg import Odometry

from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import se3_to_odometry
from sphere_nav_tools.offline.refine_camera import mounting_by_odometry, mounting_lines, mounting_values

STEP_NS = 50_000_000
CAMERA = SE3.from_angles(0.02, 0.1, 0.4, [0.6, -0.1, 1.1])


def drive(folder, count):
    """A bag with the odometry of a vehicle that weaves, and its camera's poses between those messages."""
    T_odom_base, poses = SE3.identity(), []
    with BagWriter(folder) as bag:
        bag.add_topic("/wheels", Odometry, qos.SENSOR)
        for k in range(count):
            step = SE3.exp([0.04, 0.0, 0.0, 0.0, 0.0, 0.02 * np.sin(0.05 * k)])
            stamp = 1_000_000_000 + k * STEP_NS
            message = se3_to_odometry(T_odom_base, np.zeros((6, 6)), stamp, ("odom", "base_link"))
            bag.write("/wheels", message, stamp)
            between = T_odom_base @ SE3.exp(0.5 * step.log())
            poses.append(SE3.from_planar(5.0, 1.0, 0.7) @ between @ CAMERA @ T_BODY_OPTICAL)
            T_odom_base = T_odom_base @ step
    stamps = 1_000_000_000 + STEP_NS // 2 + STEP_NS * np.arange(count)
    return Trajectory(stamps, SE3(np.stack([pose.matrix for pose in poses])))


def options(folder, mounting=""):
    return SimpleNamespace(source=folder, mounting=mounting)


@pytest.mark.slow
def test_the_file_says_where_the_camera_sits(tmp_path):
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
