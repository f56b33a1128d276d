"""What the first messages of a topic show, and why none of them can be used: by the conversions of the nodes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage

from sphere_nav.geometry import Pinhole
from sphere_nav.ros.bags.streams import CAMERA_INFO, COMPRESSED, IMAGE, Stream, examine_samples
from sphere_nav.ros.conversions import array_to_image, camera_to_info
from sphere_nav.ros.conversions.headers import header
from worlds.streams import compressed, image

SECOND = 10**9
GRAY = np.arange(48, dtype=np.uint8).reshape(6, 8)
DEPTH = np.full((6, 8), 1500, np.uint16)
PNG = cv2.imencode(".png", DEPTH)[1].tobytes()


def raw(pixels, encoding):
    return examine_samples([(s, array_to_image(pixels, s, "a", encoding)) for s in (SECOND, 2 * SECOND)], IMAGE, "/a")


def packed(data, format_, topic="/a/compressed"):
    messages = [(s, CompressedImage(header=header(s, "a"), format=format_, data=data)) for s in (SECOND, 2 * SECOND)]
    return examine_samples(messages, COMPRESSED, topic)


def test_a_good_image_shows_its_frame_size_and_encoding_and_one_is_enough():
    shown = raw(GRAY, "mono8")
    assert (shown.frame_id, shown.width, shown.height, shown.encoding, shown.problem) == ("a", 8, 6, "mono8", "")
    good = array_to_image(GRAY, 2 * SECOND, "a", "mono8")
    bad = array_to_image(GRAY, SECOND, "a", "mono8")
    bad.encoding = "yuv444"
    assert examine_samples([(1, bad), (2, good)], IMAGE, "/a").problem == ""
    assert "encoding: expected one of" in examine_samples([(1, bad), (2, bad)], IMAGE, "/a").problem


def test_what_cannot_be_unpacked_is_a_problem_that_names_the_format():
    for data, format_, words in [
        (b"\x00\x00\x00\x01\x67\x42", "h264", "format 'h264': image data: expected PNG or JPEG"),
        (bytes(12) + PNG, "16UC1; compressedDepth rvl", "found '16UC1; compressedDepth rvl'"),
        (PNG[:40], "16UC1; png compressed", "image data: expected an image"),
    ]:
        assert words in packed(data, format_).problem


@pytest.mark.parametrize(("format_", "topic"), [("16UC1; png compressed", "/a"), ("png", "/depth/compressed")])
def test_sixteen_bits_in_a_png_are_depth_not_a_picture(format_, topic):
    shown = packed(PNG, format_, topic)
    assert (shown.width, shown.height, shown.problem, shown.is_depth) == (8, 6, "", True)
    assert not packed(cv2.imencode(".png", GRAY)[1].tobytes(), "png").is_depth


def test_depth_that_measures_nothing_and_stamps_that_are_none_are_a_problem():
    assert "expected some measured pixels" in raw(np.zeros((6, 8), np.uint16), "16UC1").problem
    assert raw(DEPTH, "16UC1").problem == ""
    for stamps, words in [
        ((0, 0), "header.stamp: expected a time, found 0"),
        ((5 * SECOND,) * 3, "expected one that grows, found 5.000 s 3 times"),
    ]:
        messages = [(number, array_to_image(GRAY, stamp, "a", "mono8")) for number, stamp in enumerate(stamps)]
        assert words in examine_samples(messages, IMAGE, "/a").problem


def test_stamps_ahead_of_the_recorder_are_measured_by_the_least_lead():
    messages = [(time, array_to_image(GRAY, time + lead, "a", "mono8")) for time, lead in ((1, 900), (500, 300))]
    assert examine_samples(messages, IMAGE, "/a").lead_ns == 300
    late = [(time, array_to_image(GRAY, time - 5, "a", "mono8")) for time in (10, 20)]
    assert examine_samples(late, IMAGE, "/a").lead_ns == 0


def test_a_calibration_has_the_size_of_its_images():
    info = camera_to_info(Pinhole(640, 480, 500.0, 500.0, 319.5, 239.5), SECOND, "a")
    info.binning_x = info.binning_y = 2
    shown = examine_samples([(1, info)], CAMERA_INFO, "/camera_info")
    assert (shown.width, shown.height, shown.problem, shown.is_projected) == (320, 240, "", True)
    info.k = [0.0] * 9
    shown = examine_samples([(1, info)], CAMERA_INFO, "/camera_info")
    assert "found focal length 0" in shown.problem
    assert shown.is_projected


def test_depth_pictures_and_transports_are_told_apart():
    for stream, is_depth, is_picture, base in [
        (image("/front/image_raw"), False, True, "/front/image_raw"),
        (image("/depth/image_raw", "16UC1"), True, False, "/depth/image_raw"),
        (compressed("/d/image_raw/compressedDepth", "16UC1; compressedDepth png"), True, False, "/d/image_raw"),
        (Stream("/odom/compressed", "nav_msgs/msg/Odometry", 9, 5.0), False, False, "/odom"),
    ]:
        assert (stream.is_depth, stream.is_picture, stream.base) == (is_depth, is_picture, base)
