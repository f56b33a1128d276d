"""What frame_to_frame computes by itself: whose poses are true, and the best peer."""

import cv2
import numpy as np
import pytest

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
