"""`sphere_nav view`: a picture without a browser, and what a drive shows."""

from argparse import ArgumentParser

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info
from sphere_nav.ros.maps.reader import open_map, save_map
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.view import view
from sphere_nav_tools.cli.view.drive import Drive
from worlds.localizer import PINHOLE, STEP_NS, drive, make_map
from worlds.room import Room, optical

NUM_IMAGES = 10
TUNED = ["--set", "acceptance.min_pixels=200", "--set", "alignment.num_levels=4"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder, room = tmp_path_factory.mktemp("view"), Room()
    save_map(folder / "map", make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-1.0, 0.0, 1.0)]).graph)
    with BagWriter(folder / "bag") as bag:
        bag.add_topic("/camera_info", CameraInfo, qos.STATE)
        bag.add_topic("/image_raw", Image, qos.STATE)
        for k, T in enumerate(drive(NUM_IMAGES)):
            stamp = 10**9 + k * STEP_NS
            bag.write("/camera_info", camera_to_info(PINHOLE, stamp, "optical"), stamp)
            image = array_to_image(room.photograph(PINHOLE, T, k), stamp, "optical", "mono8")
            bag.write("/image_raw", image, stamp)
    return folder


@pytest.mark.slow
def test_a_screenshot_is_what_a_camera_sees_there(folder, tmp_path, capsys):
    output = tmp_path / "view.png"
    words = ["view", str(folder / "map"), "--screenshot", str(output), "--size", "160x120", "--fov", "70"]
    assert main([*words, "--pose", "0.3,0.2,0.1,30,5"]) == 0
    assert "seen" in capsys.readouterr().out
    focal = 80 / np.tan(np.radians(35))
    turn = SE3.exp([0, 0, 0, 0, 0, np.radians(30)]) @ SE3.exp([0, 0, 0, 0, np.radians(5), 0])
    T = optical(SE3.from_parts(np.eye(3), [0.3, 0.2, 0.1]) @ turn)
    gray, _ = Room().render(Pinhole(160, 120, focal, focal, 79.5, 59.5), T)
    assert np.median(np.abs(cv2.imread(str(output), cv2.IMREAD_GRAYSCALE) - gray)) < 6
    assert main([*words, "--sphere", "1"]) == 2  # nothing is overwritten
    assert "expected no such file" in capsys.readouterr().err


@pytest.mark.slow
def test_a_drive_is_localized_image_by_image(folder):
    parser = ArgumentParser()
    view.add_arguments(parser)
    arguments = parser.parse_args([str(folder / "map"), "--bag", str(folder / "bag"), *TUNED])
    with open_map(folder / "map") as reader:
        shown = Drive(arguments, reader)
        shots = list(shown.shots())
        shown.close()
    assert len(shots) == NUM_IMAGES
    truth = drive(NUM_IMAGES)
    for shot, T in list(zip(shots, truth, strict=True))[-4:]:
        assert shot.T_map_camera.distance(T)[0] < 0.02
        assert "TRACKING" in shot.text
        assert shot.image.shape == (120, 160, 3)
        assert np.abs(shot.residual.astype(int) - 128).mean() < 8
