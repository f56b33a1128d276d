"""The images of a camera of a bag, raw or compressed."""

from argparse import ArgumentParser

import cv2
import numpy as np
from sensor_msgs.msg import CameraInfo, CompressedImage

from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import camera_to_info, image_to_gray
from sphere_nav.ros.conversions.stamps import header
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.recorded_camera import RecordedCamera
from worlds.localizer import PINHOLE


def arguments():
    parser = ArgumentParser()
    topics.add_options(parser)
    return parser.parse_args([])


def test_compressed_images_come_with_stamp_and_calibration(tmp_path, rng):
    image = rng.integers(0, 255, (PINHOLE.height, PINHOLE.width), np.uint8)
    data = cv2.imencode(".png", image)[1].tobytes()
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/front/camera_info", CameraInfo, qos.STATE)
        bag.add_topic("/front/image_raw/compressed", CompressedImage, qos.STATE)
        bag.write("/front/camera_info", camera_to_info(PINHOLE, 5, "front_optical"), 5)
        message = CompressedImage(header=header(7, "front_optical"), format="png", data=data)
        bag.write("/front/image_raw/compressed", message, 7)
    recorded = RecordedCamera(tmp_path / "bag", arguments())
    assert recorded.frame_id == "front_optical"
    assert recorded.camera == PINHOLE
    ((stamp, found),) = recorded.messages()
    assert stamp == 7
    assert np.array_equal(image_to_gray(found), image)
