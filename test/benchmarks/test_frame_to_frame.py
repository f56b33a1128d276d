"""What frame_to_frame computes by itself: whose poses are true, and the best peer."""

import cv2
import numpy as np
import pytest

from benchmarks.real.frame_to_frame import OURS, bounds_of
from benchmarks.rgbd_data import Recording
from sphere_nav.geometry import SE3


def test_frames_are_those_of_the_color_camera_with_the_poses_beside_the_recording(tmp_path):
    folder, poses = tmp_path / "rgbd" / "redkitchen", tmp_path / "rgbd" / "redkitchen_colmap_poses"
    folder.mkdir(parents=True)
    assert Recording.open(tmp_path) is None
    poses.mkdir()
    for i in range(3):
        cv2.imwrite(str(folder / f"frame-{i:06d}.color.png"), np.full((480, 640, 3), 100, np.uint8))
        cv2.imwrite(str(folder / f"frame-{i:06d}.depth.png"), np.full((480, 640), 2000, np.uint16))
        np.savetxt(poses / f"frame-{i:06d}.pose.txt", SE3.exp([0.0, 0.2 * i, 0, 0, 0, 0]).matrix)
    found = Recording.open(tmp_path)
    frame = found.frame(found.pairs(2, 1)[0][1])
    np.testing.assert_allclose(frame.T_world_camera.translation, [0.0, 0.4, 0.0], atol=1e-12)
    assert frame.depth_m[240, 320] == pytest.approx(2.0)
    seen = np.flatnonzero(np.isfinite(frame.depth_m).any(axis=0))
    middle = 320 - 525 * 0.025 / 2.0  # of the depth image: its camera is 2.5 cm to the right
    assert seen.mean() == pytest.approx(middle, abs=2.0)


def test_the_bound_is_the_best_peer():
    figures = {
        OURS: np.array([(1.0, 0.0, 2.0), (2.0, 0.0, 2.0), (60.0, 0.0, 2.0)]),
        "A": np.array([(5.0, 0.0, 30.0), (5.0, 0.0, 30.0), (1.0, 0.0, 30.0)]),
        "B": np.array([(1.5, 0.0, 40.0), (2.0, 0.0, 40.0), (1.0, 0.0, 40.0)]),
    }
    failures, error, time = bounds_of(figures, 1)
    assert (failures.measured, error.bound, error.measured) == (1, 1.5, 2.0)
    assert error.headline.peer.startswith("B: 1.5")
    assert (time.measured, time.is_met) == (15.0, True)
    assert bounds_of({OURS: figures[OURS]}, 1) == [failures]
