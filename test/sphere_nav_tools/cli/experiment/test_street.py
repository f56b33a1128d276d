"""How the drives along the street are recorded and judged; nothing is mapped here."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav_tools.cli.experiment.street import (
    CAMERA,
    MOUNTING,
    MonoDrive,
    StereoDrive,
    drift_percent,
    relative_errors_m,
)

# Written out: imported, a change would go unseen.
AHEAD, BASELINE, BESIDE, PERIOD_NS, SPEED = 0.6, 0.54, 0.3, 100_000_000, 13.9


def along_x(shift=(0.0, 0.0, 0.0), scale=1.0, count=11):
    poses = [SE3.from_parts(np.eye(3), [10.0 * scale * i + shift[0], shift[1], shift[2]]).matrix for i in range(count)]
    return Trajectory(np.arange(1, count + 1, dtype=np.int64) * PERIOD_NS, SE3(np.array(poses)))


def test_drift_is_that_of_the_end_seen_from_the_beginning():
    assert drift_percent(along_x((3.0, -2.0, 1.0)), along_x()) == pytest.approx(0.0, abs=1e-9)
    assert drift_percent(along_x(scale=1.01), along_x()) == pytest.approx(1.0)
    turned = along_x().moved(SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.3]))
    assert drift_percent(turned, along_x()) == pytest.approx(0.0, abs=1e-9)


def test_the_drift_of_the_map_does_not_count_on_the_second_drive():
    truth, beside = along_x(), along_x((0.0, 0.3, 0.0))
    mapped = along_x(scale=1.02)
    poses = [SE3.from_parts(np.eye(3), [10.2 * i, 0.3, 0.0]).matrix for i in range(11)]
    found = Trajectory(beside.stamps_ns, SE3(np.array(poses)))
    np.testing.assert_allclose(relative_errors_m(found, beside, mapped, truth), 0.0, atol=1e-9)
    np.testing.assert_allclose(relative_errors_m(mapped, beside, mapped, truth), 0.3, atol=1e-9)


@pytest.fixture(scope="module")
def stereo():
    drive = StereoDrive(3, {"render.shadow_texel": 0.0, "traffic.density": "none", "render.supersampling": 1}, 30.0)
    return drive, [dict(drive.frame(index)) for index in (0, 1)]


@pytest.mark.slow
def test_the_pair_drives_at_the_speed_of_traffic_and_shakes(stereo):
    drive, _ = stereo
    assert drive.num_frames == int(30.0 / (SPEED * PERIOD_NS * 1e-9))
    first, second = drive.poses
    assert np.linalg.norm(second.translation - first.translation) == pytest.approx(1.39, abs=1e-6)
    assert 1e-4 < np.abs(first.angles[:2]).max() < 0.02
    assert np.diff(drive.trajectory.stamps_ns) == PERIOD_NS


@pytest.mark.slow
def test_the_right_image_is_the_left_one_moved_by_the_range(stereo):
    drive, frames = stereo
    left, right = (
        np.frombuffer(frames[1][f"{side}/image_raw"].data, np.uint8).reshape(480, 640).astype(float)
        for side in ("left", "right")
    )
    info = frames[1]["right/camera_info"]
    assert -info.p[3] / info.p[0] == pytest.approx(BASELINE)
    below = slice(440, 470)  # the road: its height gives the disparity
    rows = np.arange(440, 470)
    pitch, height = drive.poses[1].angles[1], MOUNTING[2]
    slope = (rows - CAMERA.cy) / CAMERA.fy
    disparity = BASELINE / height * CAMERA.fx * (slope + np.tan(pitch))  # to first order in the shake
    moved = np.array(
        [np.interp(np.arange(640) - d, np.arange(640), row) for d, row in zip(disparity, right[below], strict=True)]
    )
    there, still = slice(150, 600), left[below]
    assert np.corrcoef(moved[:, there].ravel(), still[:, there].ravel())[0, 1] > 0.6
    assert np.corrcoef(right[below, there].ravel(), still[:, there].ravel())[0, 1] < 0.5


@pytest.mark.slow
def test_the_second_drive_is_beside_the_first_one_by_one_camera():
    drive = MonoDrive(3, {"render.shadow_texel": 0.0, "traffic.density": "none", "render.supersampling": 1}, 30.0)
    message = dict(drive.frame(0))["image_raw"]
    assert (message.width, message.height) == (640, 480)
    x, y, yaw, _ = drive.simulator.path.at(0.0)
    off = drive.poses[0].translation[:2] - [x, y]
    assert off == pytest.approx([AHEAD, BESIDE], abs=1e-6)  # the road begins along x
    assert yaw == 0.0
    drive.drive_to(150)  # in the first bend
    x, y, yaw, _ = drive.simulator.path.at(150 * SPEED * PERIOD_NS * 1e-9 + AHEAD)
    off = drive.simulator.T_world_base.translation[:2] - [x, y]
    assert off == pytest.approx([-BESIDE * np.sin(yaw), BESIDE * np.cos(yaw)], abs=1e-6)
    assert yaw > 0.3
