"""Messages that nobody means are refused in one line, by each conversion; what is just within is taken."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import CompressedImage
from sphere_nav_msgs.msg import FollowerStatus

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.ros import conversions as c
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import driving
from sphere_nav.spheres.sphere import Sphere

LENS, WHOLE = Pinhole(40, 30, 30.0, 31.0, 19.5, 14.5), Spherical(64, 32)
T = SE3.exp([1.0, -2.0, 0.5, 0.3, -0.2, 0.7])
TWIST = np.array([1.0, 0.2, -0.1, 0.1, -0.3, 0.2])
DEPTH = np.arange(6, dtype=np.uint16).reshape(2, 3)


def info(**values: Any) -> Any:
    message = c.camera_to_info(LENS, 1, "camera")
    for index, value in values.get("k", {}).items():
        message.k[index] = value
    return message


def sphere_info(**values: Any) -> Any:
    return changed(c.camera_to_sphere_info(WHOLE, "sphere"), **values)


def odometry(x: float) -> Any:
    message = c.se3_to_odometry(T, np.eye(6), 1, ("odom", "base"), TWIST)
    message.twist.twist.angular.z = x
    return message


def path(frame: str) -> PathMessage:
    message = c.poses_to_path([(1, T), (2, T @ T)], 3, "map")
    message.poses[1].header.frame_id = frame
    return message


def depth(pixels: Any, head: tuple[int, float, float] = (0, 1.0, 0.0), form: str = "16UC1; compressedDepth png") -> Any:
    data = struct.pack("<iff", *head) + cv2.imencode(".png", pixels)[1].tobytes()
    return CompressedImage(format=form, data=data)


def changed(message: Any, **values: Any) -> Any:
    for name, value in values.items():
        setattr(message, name, value)
    return message


def bare_sphere(**values: Any) -> Any:
    sphere = Sphere(np.full((32, 64), 9, np.uint8), np.full((32, 64), 2.0, np.float32), WHOLE, 1)
    return changed(c.sphere_to_message(sphere, "sphere"), **values)


def gray() -> Any:
    return c.array_to_image(np.zeros((5, 7), np.uint8), 1, "a", "mono8")


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "skewed camera": (lambda: c.camera_from_info(info(k={1: 0.1})), "K: expected no skew"),
    "camera of another row": (lambda: c.camera_from_info(info(k={8: 2.0})), "K: expected no skew and a last row"),
    "another projection": (lambda: c.sphere_info_to_camera(sphere_info(projection="cube")), "info.projection"),
    "window beside": (lambda: c.sphere_info_to_camera(sphere_info(offset_u=65.0)), "info.offset_u, offset_v"),
    "window below": (lambda: c.sphere_info_to_camera(sphere_info(offset_v=1.0)), "info.offset_u, offset_v"),
    "window nowhere": (lambda: c.sphere_info_to_camera(sphere_info(offset_u=float("nan"))), "info.offset_u, offset_v"),
    "turn that is none": (lambda: c.odometry_to_se3(odometry(float("nan"))), "odometry twist: expected finite"),
    "path through frames": (lambda: c.path_to_poses(path("odom")), "poses.1..header.frame_id: expected 'map', found"),
    "endless way": (lambda: driving.message_to_progress(FollowerStatus(progress=float("inf"))), "progress, distance"),
    "no image": (lambda: c.image_to_array(c.array_to_image(np.zeros((0, 4), np.uint8), 1, "a", "mono8")), "image size"),
    "cloud of another width": (lambda: c.message_to_cloud(changed(c.cloud_to_message(np.eye(3), 0, "map"), width=4)),
                               "cloud data: expected 1 rows of 36 bytes"),
    "image of short rows": (lambda: c.image_to_array(changed(gray(), step=6)), "step: expected at least 7"),
    "image of more rows": (lambda: c.image_to_array(changed(gray(), height=6)), "data: expected 42 bytes"),
    "sphere of another code": (lambda: c.message_to_sphere(bare_sphere(range_encoding="32FC1")), "expected log16"),
    "sphere of no picture": (lambda: c.message_to_sphere(bare_sphere(image_encoding="tiff")), "mono8, rgb8 or png"),
    "sphere of 3 x 2": (lambda: c.message_to_sphere(bare_sphere(image_encoding="png", image=depth(DEPTH).data[12:])),
                        "found 3 x 2"),
    "sphere of few pixels": (lambda: c.message_to_sphere(bare_sphere(image=bytes(9))), "image: expected 2048 bytes"),
    "sphere of few ranges": (lambda: c.message_to_sphere(bare_sphere(range=bytes(9))), "range: expected 4096 bytes"),
    "depth of nothing": (lambda: c.depth_to_meters(CompressedImage(format="16UC1; compressedDepth", data=bytes(12))),
                         "expected a header of 12 bytes and a PNG, found 12"),
    "depth without scale": (lambda: c.depth_to_meters(depth(DEPTH, (0, np.inf, 0.0), "32FC1; compressedDepth png")),
                            "expected finite depth parameters"),
    "depth of bytes": (lambda: c.depth_to_meters(depth(DEPTH.astype(np.uint8))), "a PNG of one channel of 16 bits"),
    "depth by rvl": (lambda: c.depth_to_meters(depth(DEPTH, form="16UC1; compressedDepth rvl")), "format of"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_a_message_that_nobody_means_is_one_line(what: str) -> None:
    make, expected = REFUSED[what]
    with pytest.raises(ValueError, match=expected) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_what_is_just_within_is_taken() -> None:
    assert c.camera_from_info(info()) == LENS
    assert c.sphere_info_to_camera(sphere_info(offset_u=64.0)).offset_u == 64.0
    np.testing.assert_allclose(c.odometry_to_se3(odometry(0.2))[1], TWIST)
    for frame in ("", "map"):
        found = c.path_to_poses(path(frame))
        assert [stamp for stamp, _ in found] == [1, 2]
        np.testing.assert_allclose(found[1][1].matrix, (T @ T).matrix, atol=1e-12)
    meters = np.where(DEPTH, DEPTH * np.float32(1e-3), np.float32(np.nan))
    np.testing.assert_array_equal(c.depth_to_meters(depth(DEPTH)), meters)
    meters = c.depth_to_meters(depth(DEPTH, (0, 6.0, 1.0), "32FC1; compressedDepth png"))
    np.testing.assert_array_equal(meters, [[np.nan, np.nan, 6.0], [3.0, 2.0, 1.5]])
    assert np.isnan(c.message_to_sphere(bare_sphere(range_encoding="", range=b"")).range_m).all()


def test_a_mounting_is_six_numbers_or_a_file_of_them(tmp_path: Path) -> None:
    expected = SE3.from_angles(0.1, -0.2, 0.3, [1.0, 0.0, 1.6])
    (tmp_path / "a.yaml").write_text("{x: 1.0, y: 0.0, z: 1.6, roll: 0.1, pitch: -0.2, yaw: 0.3}")
    for text in ("1.0,0,1.6,0.1,-0.2,0.3", str(tmp_path / "a.yaml")):
        np.testing.assert_allclose(read_mounting(text).matrix, expected.matrix, atol=1e-12)
    (tmp_path / "a.yaml").write_text("{x: 1.0, y: 0.0}")
    for text in ("1,2,3", "a,b,c,d,e,f", "0,0,900,0,0,0", str(tmp_path / "a.yaml"), str(tmp_path / "none.yaml")):
        with pytest.raises(ValueError, match="mounting: ") as caught:
            read_mounting(text)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("advice", "state", "reason"),
    [
        (SimpleNamespace(is_clear=True, is_finished=False, lead=3.0), "DRIVING", ""),
        (SimpleNamespace(is_clear=True, is_finished=True, lead=3.0), "FINISHED", ""),
        (SimpleNamespace(is_clear=False, is_finished=True, lead=0.5), "STOPPED", "NOT_LOCALISED"),
        (None, "STOPPED", "NOT_LOCALISED"),
    ],
)
def test_a_guide_that_is_not_sure_of_its_place_stops_the_car(advice: Any, state: str, reason: str) -> None:
    message = driving.guide_status_to_message(advice, (2.0, 5.0), 1.0, 7, "map")
    assert (message.state, message.reason, message.is_armed) == (state, reason, True)
    assert driving.message_to_progress(message) == (state, (2.0, 5.0))
    assert (message.value, message.limit) == ((advice.lead if advice else 0.0, 1.0) if reason else (0.0, 0.0))
