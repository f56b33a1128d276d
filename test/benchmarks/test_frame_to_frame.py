"""What frame_to_frame computes by itself: whose poses are true, halves, and the best peer."""

import cv2
import numpy as np
import pytest

from benchmarks.frame_to_frame import OURS, Figures, _against_best
from benchmarks.rgbd_data import colmap_poses, open_recording
from sphere_nav.geometry import SE3


@pytest.fixture
def recording(tmp_path):
    folder = tmp_path / "kitchen"
    folder.mkdir()
    for i in range(3):
        stem = folder / f"frame-{i:06d}"
        cv2.imwrite(f"{stem}.color.png", np.full((480, 640, 3), 100, np.uint8))
        cv2.imwrite(f"{stem}.depth.png", np.full((480, 640), 2000, np.uint16))
        np.savetxt(f"{stem}.pose.txt", SE3.exp([0.1 * i, 0, 0, 0, 0, 0.5 * i]).matrix)
    return folder


def test_recorded_poses_are_those_of_the_depth_camera(recording):
    found = open_recording(recording)
    path = found.pairs(1, 1)[1][0]
    unregistered, registered = (found.frame(path, calibration) for calibration in found.calibrations)
    T_depth_color = unregistered.T_world_camera.inverse() @ registered.T_world_camera
    np.testing.assert_allclose(T_depth_color.translation, [0.025, 0.0, 0.0], atol=1e-12)


def test_poses_beside_the_recording_are_those_of_the_color_camera(recording):
    assert colmap_poses(recording) is None
    poses = recording.with_name("kitchen_colmap_poses")
    poses.mkdir()
    for i in range(3):
        np.savetxt(poses / f"frame-{i:06d}.pose.txt", SE3.exp([0.0, 0.2 * i, 0, 0, 0, 0]).matrix)
    found = open_recording(recording, colmap_poses(recording))
    (calibration,) = found.calibrations
    frame = found.frame(found.pairs(2, 1)[0][1], calibration)
    np.testing.assert_allclose(frame.T_world_camera.translation, [0.0, 0.4, 0.0], atol=1e-12)
    assert calibration.camera.fx == 525.0
    assert frame.depth_m[240, 320] == pytest.approx(2.0)


def test_the_bound_is_the_best_peer_of_each_half():
    figures = {
        OURS: Figures([1.0, 2.0, 3.0, 4.0], [0.0] * 4),
        "no motion": Figures([0.0] * 4, [0.0] * 4),
        "A": Figures([5.0, 5.0, 1.0, 1.0], [0.0] * 4),
        "B": Figures([2.0, 2.0, 9.0, 9.0], [0.0] * 4),
    }
    whole, first, second = _against_best(figures, "k = 1")
    assert (whole.bound, whole.measured, whole.is_met) == (3.0, 2.5, True)
    assert (first.bound, first.measured, first.is_met) == (2.0, 1.5, True)
    assert (second.bound, second.measured, second.is_met) == (1.0, 3.5, False)
    assert "B" in first.what
    assert "A" in second.what
