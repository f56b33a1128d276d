"""The recorded data sets themselves, where they are there."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.ros.conversions import depth_to_meters, image_to_gray, pose_to_se3
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing.kitti import open_kitti
from sphere_nav_tools.offline.importing.rgbd import open_seven_scenes

COLOR = Pinhole(640, 480, 525.0, 525.0, 320.0, 240.0)


def residual(first, second, camera, is_moved=True):
    """Mean grey difference of two frames (pose of the body, image, depth), the first warped into the second."""
    T_body_first, image_first, depth = first
    T_body_second, image_second, _ = second
    if not is_moved:
        T_body_second = T_body_first
    rays = camera.unproject(pixel_grid(camera))
    points = (rays / rays[..., 2:] * depth[..., None])[::4, ::4].reshape(-1, 3)
    gray = image_first[::4, ::4].ravel()[np.isfinite(points[:, 2])]
    points = points[np.isfinite(points[:, 2])]
    T_second_first = T_BODY_OPTICAL.inverse() @ T_body_second.inverse() @ T_body_first @ T_BODY_OPTICAL
    pixels, visible = camera.project(T_second_first.apply(points))
    u, v = np.rint(pixels[visible]).astype(int).T
    return np.mean(np.abs(image_second[np.clip(v, 0, 479), np.clip(u, 0, 639)].astype(float) - gray[visible]))


def frame(recording, index):
    messages = dict(recording.frame(index))
    pose = pose_to_se3(messages["ground_truth/pose"].pose)
    return pose, image_to_gray(messages["image_raw"]), depth_to_meters(messages["depth/image_raw"])


@pytest.mark.slow
def test_a_depth_camera_left_where_it_is_does_not_fit_the_kitchen(shared_data):
    """The true motion explains the images, with depth moved into the colour camera better than without."""
    folder = shared_data / "rgbd" / "redkitchen"
    kinect = replace(COLOR, fx=585.0, fy=585.0), SE3.exp([-0.025, 0, 0, 0, 0, 0])
    moved = open_seven_scenes(folder, COLOR, kinect, is_truth_of_depth=True)
    one = Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
    unmoved = open_seven_scenes(folder, one, None, is_truth_of_depth=True)
    first, second = frame(moved, 0), frame(moved, 20)
    with_motion = residual(first, second, COLOR)
    assert with_motion < 0.6 * residual(first, second, COLOR, is_moved=False)
    assert with_motion < residual(frame(unmoved, 0), frame(unmoved, 20), one)
    assert np.isfinite(first[2]).mean() > 0.6


def test_a_car_of_kitti_drives_forward(shared_data):
    recording = open_kitti(shared_data / "driving" / "kitti_06")
    assert recording.num_frames == 51
    assert recording.views["right"].baseline_m == pytest.approx(0.5371, abs=1e-4)
    poses = [pose_to_se3(dict(recording.frame(index))["ground_truth/pose"].pose) for index in (0, 50)]
    np.testing.assert_allclose(poses[0].matrix, np.eye(4), atol=1e-6)
    x, y, z = poses[1].translation
    assert x == pytest.approx(59.9, abs=0.5)  # README of the data: 59.9 m straight
    assert abs(y) < 5.0
    assert abs(z) < 2.0
