"""Images that cannot be used: one suite for both localisers, one status each, the same reason in both."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import Image

from dense_localizer.ros.node import DenseLocalizerNode
from mcl_depth.ros.node import MclDepthNode
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import array_to_image, camera_to_info, header
from sphere_nav.ros.maps.reader import save_map
from worlds.localizer import SMALL_IMAGES, Room, make_map
from worlds.mcl import SETTINGS, room_points

CAMERA = Pinhole(160, 120, 120.0, 120.0, 79.5, 59.5)
OTHER = Pinhole(160, 120, 125.0, 120.0, 79.5, 59.5)
SECOND = 10**9
STEP = SECOND // 10
INPUT_REASONS = {"TIMEOUT", "FROZEN", "BAD_STAMP", "BAD_INFO", "TF_STALE", "LOW_TEXTURE"}


class Car:
    def __init__(self, node_class, values):
        self.bus, self.now = OfflineBus(), 100 * SECOND
        self.node = self.bus.add(node_class, {"base_frame": ""} | values)
        list(self.bus.advance(self.now))

    def begin(self):
        assert self.node.endpoints.call("reset").success
        self.wait(20 * SECOND)
        self.calibrate(CAMERA)
        assert self.see().reason not in INPUT_REASONS

    def statuses(self, records):
        return [record.message for record in records if record.topic == "/status"]

    def wait(self, nanoseconds):
        self.now += nanoseconds
        return self.statuses(self.bus.advance(self.now))

    def send(self, topic, message):
        self.bus.publish(topic, message)
        return self.statuses(self.bus.settle())

    def calibrate(self, camera, focal=None):
        message = camera_to_info(camera, self.now, "camera")
        if focal is not None:
            message.k = [focal, 0.0, 79.5, 0.0, focal, 59.5, 0.0, 0.0, 1.0]
        self.send("/camera_info", message)

    def pixels(self):
        """Return noise that a blur has given structure, another each time."""
        noise = np.random.default_rng(self.now).integers(0, 255, (CAMERA.height, CAMERA.width)).astype(np.uint8)
        return cv2.normalize(cv2.GaussianBlur(noise, (9, 9), 2.0), None, 20, 230, cv2.NORM_MINMAX)

    def see(self, pixels=None, *, encoding="mono8", stamp=None, frame="camera"):
        """Show an image a step later; return the one status that answers it."""
        self.wait(STEP)
        pixels = self.pixels() if pixels is None else pixels
        return self.answer(array_to_image(pixels, self.now if stamp is None else stamp, frame, encoding))

    def answer(self, message):
        [status] = self.send("/image_raw", message)
        return status


@pytest.fixture(scope="module", params=["dense_localizer", pytest.param("mcl_depth", marks=pytest.mark.slow)])
def localizer(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    if request.param == "dense_localizer":
        sphere_map = make_map(Room(), [SE3.identity()])
        return Car(
            DenseLocalizerNode,
            {"map": str(save_map(folder / "room", sphere_map.graph)), "automatic": False} | SMALL_IMAGES,
        )
    np.save(folder / "room.npy", room_points(0.1))
    return Car(MclDepthNode, {"cloud": str(folder / "room.npy"), "camera_height": 1.2} | SETTINGS)


def raw(car, **fields):
    values = {"encoding": "mono8", "width": 160, "height": 120, "step": 160, "data": bytes(160 * 120)} | fields
    return Image(header=header(car.now, "camera"), **values)


def see_twice(car):
    stamp = car.now
    return car.see(stamp=stamp)


def see_another_calibration(car):
    car.calibrate(OTHER)
    return car.see()


def see_uncalibrated(car):
    car.calibrate(CAMERA, focal=0.0)
    return car.see()


def see_frozen(car):
    pixels = car.pixels()
    return [car.see(pixels) for _ in range(6)][-1]


CASES = {
    "encoding": (lambda car: car.answer(raw(car, encoding="nonsense")), "BAD_INFO", "nonsense"),
    "size": (lambda car: car.see(np.ascontiguousarray(car.pixels()[:100, :100])), "BAD_INFO", "100 x 100"),
    "step": (lambda car: car.answer(raw(car, step=150)), "BAD_INFO", "step"),
    "too little data": (lambda car: car.answer(raw(car, data=bytes(99))), "BAD_INFO", "data"),
    "NaN": (lambda car: car.see(np.full((120, 160), np.nan, np.float32), encoding="32FC1"), "BAD_INFO", "32FC1"),
    "black": (lambda car: car.see(np.zeros((120, 160), np.uint8)), "LOW_TEXTURE", "black"),
    "saturated": (lambda car: car.see(np.full((120, 160), 255, np.uint8)), "LOW_TEXTURE", "saturated"),
    "frozen": (see_frozen, "FROZEN", "identical"),
    "stamp back": (lambda car: car.see(stamp=car.now - 5 * SECOND), "BAD_STAMP", "backward"),
    "stamp repeated": (see_twice, "BAD_STAMP", "repeated"),
    "stamp zero": (lambda car: car.see(stamp=0), "BAD_STAMP", "zero"),
    "stamp of the future": (lambda car: car.see(stamp=car.now + 9 * SECOND), "BAD_STAMP", "ahead of the clock"),
    "K = 0": (see_uncalibrated, "BAD_INFO", "focal length 0"),
    "changed calibration": (see_another_calibration, "BAD_INFO", "changed while running"),
    "another camera": (lambda car: car.see(frame="rear"), "BAD_INFO", "expected 'camera' as before, found 'rear'"),
}


def test_a_bad_image_is_answered_by_its_reason_and_the_next_good_one_used(localizer):
    localizer.begin()
    for case, (show, reason, detail) in CASES.items():
        status = show(localizer)
        assert (status.reason, detail in status.remedy) == (reason, True), (case, status.remedy)
        assert status.state != "TRACKING"
        assert ";" in status.remedy  # what was found, and what to do about it
        localizer.calibrate(CAMERA)
        assert localizer.see().reason not in INPUT_REASONS, case


def test_a_silent_camera_is_told_by_arrival_and_a_jump_of_the_clock_is_a_new_time_after_three_images(localizer):
    localizer.begin()
    said = localizer.wait(5 * SECOND)
    assert {status.reason for status in said} == {"TIMEOUT"}
    assert localizer.see().reason not in INPUT_REASONS
    localizer.wait(60 * SECOND)
    assert [localizer.see().reason in INPUT_REASONS for _ in range(3)] == [True, True, False]
