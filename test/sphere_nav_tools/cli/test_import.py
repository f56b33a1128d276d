"""`sphere_nav import`: what is in the bags, and one line for what is missing or of another layout."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros.conversions import (
    camera_from_info,
    depth_to_meters,
    image_to_array,
    pose_to_se3,
    stamp_ns,
    stereo_baseline,
)
from sphere_nav_tools.cli import import_
from sphere_nav_tools.cli.main import main


def test_seven_scenes(imported, seven_scenes, box_and_wall):
    topics, frames = imported("seven_scenes", seven_scenes)
    assert {name: len(messages) for name, messages in topics.items()} == {
        "/tf_static": 1,
        "/ground_truth/pose": 3,
        "/camera_info": 3,
        "/depth/camera_info": 3,
        "/depth/image_raw": 3,
        "/image_raw": 3,
    }
    camera = camera_from_info(topics["/camera_info"][0])
    assert camera == Pinhole(640, 480, 525.0, 525.0, 320.0, 240.0)
    assert [stamp_ns(message) for message in topics["/image_raw"]] == [1_000_000_000, 1_033_333_333, 1_066_666_667]
    assert topics["/image_raw"][0].encoding == "bgr8"
    # where the colour camera sees the faces: 25 mm to the right of the depth camera
    T_world_color = SE3.exp([0.025, 0, 0, 0, 0, 0])
    depth = depth_to_meters(topics["/depth/image_raw"][0])
    expected = box_and_wall(camera, T_world_color)
    found = np.isfinite(depth)
    assert found[60:-60, 60:-60].mean() > 0.98  # all but what the depth camera cannot see beside the box
    assert np.mean(np.abs(depth - expected)[found] < 0.01) > 0.999
    pose = pose_to_se3(topics["/ground_truth/pose"][2].pose)
    # the body of the colour camera: optical x (right) is body -y, 0.2 m and 25 mm from the first depth camera
    np.testing.assert_allclose(pose.translation, [0.0, -0.225, 0.0], atol=1e-9)
    np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-9)
    T_base_optical = frames.lookup("base_link", "camera_optical")
    np.testing.assert_allclose(T_base_optical.apply([[0.0, 0.0, 1.0]]), [[1.0, 0.0, 0.0]], atol=1e-12)


def test_tum(imported, tum):
    topics, _ = imported("tum", tum, "--camera", "500,501,320,240")
    assert len(topics["/image_raw"]) == 3  # the third has no depth within 20 ms
    assert [image_to_array(message)[0, 0, 0] for message in topics["/image_raw"]] == [5, 15, 35]
    depths = [depth_to_meters(message)[5, 5] for message in topics["/depth/image_raw"]]
    np.testing.assert_allclose(depths, [1.0, 2.0, 4.0])
    assert camera_from_info(topics["/camera_info"][0]).fy == 501.0
    poses = {stamp_ns(message): pose_to_se3(message.pose) for message in topics["/ground_truth/pose"]}
    assert sorted(poses) == [100_000_000_000, 100_100_000_000]  # the last has no truth near
    np.testing.assert_allclose(poses[100_100_000_000].translation, [1.0, 0.0, 1.0], atol=1e-6)  # interpolated


def test_kitti(imported, kitti):
    topics, frames = imported("kitti", kitti)
    assert {name: len(messages) for name, messages in topics.items()} == {
        "/tf_static": 1,
        "/ground_truth/pose": 3,
        "/left/camera_info": 3,
        "/left/image_raw": 3,
        "/right/camera_info": 3,
        "/right/image_raw": 3,
    }
    assert stereo_baseline(topics["/right/camera_info"][0]) == pytest.approx(0.54)
    assert camera_from_info(topics["/left/camera_info"][0]) == Pinhole(120, 40, 700.0, 700.0, 60.0, 20.0)
    pose = pose_to_se3(topics["/ground_truth/pose"][2].pose)
    np.testing.assert_allclose(pose.translation, [2.4, -0.2, 0.0], atol=1e-12)  # forward is x, right is -y
    T_left_right = frames.lookup("left_optical", "right_optical")
    np.testing.assert_allclose(T_left_right.translation, [0.54, 0.0, 0.0], atol=1e-12)


def test_kitti_without_times_and_truth(imported, kitti):
    for name in ("times.txt", "poses.txt"):
        (kitti / name).unlink()
    topics, _ = imported("kitti", kitti)
    assert "/ground_truth/pose" not in topics
    assert [stamp_ns(message) for message in topics["/left/image_raw"]] == [1_000_000_000, 1_100_000_000, 1_200_000_000]


def fails(capsys, tmp_path, *words):
    assert main(["import", *map(str, words), "-o", str(tmp_path / "bad")]) == 2
    assert not (tmp_path / "bad").exists()
    assert not (tmp_path / "bad.partial").exists()
    err = capsys.readouterr().err
    assert err.rstrip().count("\n") == 0
    return err


def test_a_camera_of_two_numbers(capsys, tmp_path):
    with pytest.raises(SystemExit) as ended:
        main(["import", "tum", str(tmp_path), "--camera", "525,525", "-o", str(tmp_path / "bad")])
    assert ended.value.code == 2
    err = capsys.readouterr().err
    assert "argument --camera: expected 4 to 12 numbers FX,FY,CX,CY[,K1" in err
    assert "found '525,525'" in err


@pytest.mark.parametrize("name", import_.READERS)
def test_a_folder_that_is_not_there_or_empty(name, capsys, tmp_path):
    assert "nowhere: expected a folder, found none" in fails(capsys, tmp_path, name, tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert ": expected " in fails(capsys, tmp_path, name, tmp_path / "empty")


def test_damaged_files_are_named(seven_scenes, kitti, capsys, tmp_path):
    (seven_scenes / "frame-000001.depth.png").write_bytes(b"\x89PNG")
    assert "001.depth.png: expected an image" in fails(capsys, tmp_path, "seven_scenes", seven_scenes)
    (seven_scenes / "frame-000001.pose.txt").write_text("1 0 0\n")
    assert "pose.txt: expected 4 x 4 numbers, found 1 x 3" in fails(capsys, tmp_path, "seven_scenes", seven_scenes)
    (seven_scenes / "frame-000001.pose.txt").write_text("1 0 0 1e20\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    assert "pose.txt: expected finite numbers up to 1e+15" in fails(capsys, tmp_path, "seven_scenes", seven_scenes)
    (kitti / "times.txt").write_text("0.0\n")
    assert "times.txt: expected at least 3 rows (image 000002), found 1" in fails(capsys, tmp_path, "kitti", kitti)


FILES = {
    "seven_scenes": ("frame-000000.depth.png",),
    "tum": ("rgb.txt",),
    "kitti": ("calib.txt", "image_0/000000.png"),
    "spherical": ("image_0.png", "range_0.png"),
    "openloris": ("color.txt", "aligned_depth.txt"),
    "rover": ("intelrealsense_D435i/rgb/1.5.png",),
    "euroc": ("mav0/cam0/data.csv",),
    "four_seasons": ("undistorted_images/cam0/1.png", "times.txt"),
    "nclt": ("lb3/Cam5/1326030975726043.tiff",),
}


@pytest.mark.parametrize("kind", FILES)
def test_inspect_says_how_a_data_set_becomes_a_bag(kind, tmp_path, capsys):
    for name in FILES[kind]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    main(["inspect", str(tmp_path)])
    assert f"sphere_nav import {kind} {tmp_path}" in capsys.readouterr().out
