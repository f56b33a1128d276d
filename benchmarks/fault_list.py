"""The faults of a drive: what is done to its images, to its odometry, or to its nodes."""

from __future__ import annotations

import copy
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from sphere_nav_msgs.srv import LoadMap
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage

from benchmarks.fault_drives import FRAME, PERIOD_NS, SECOND, Drive, Messages
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros import conversions
from sphere_nav.ros.camera.stream import read_gray
from sphere_nav.ros.maps.reader import FILE_NAME

Images = Callable[[Drive, Messages, float], Messages]  # the drive, an image with its calibration, s since the fault
Pixels = Callable[[np.ndarray, np.random.Generator], np.ndarray]


@dataclass
class Fault:
    """`stops`: the vehicle must stop, or must drive on; None: either, as it is localised or not."""

    number: str
    name: str
    images: Images = lambda drive, messages, age: messages
    begin: Callable[[Drive], None] = lambda drive: None
    end: Callable[[Drive], None] = lambda drive: None
    stops: bool | None = True
    has_odometry: bool = False
    seconds: float = 2.0  # that it lasts
    is_moved: bool = False  # the car is put elsewhere: its way from the path says nothing


def _none(drive: Drive, messages: Messages, age: float) -> Messages:
    return []


def _every(n: int, is_lost: bool) -> Images:
    """Lose every n-th image, or all but those."""
    return lambda drive, messages, age: [] if (drive.now // PERIOD_NS % n == 0) == is_lost else messages


def _until(seconds: float, change: Images) -> Images:
    return lambda drive, messages, age: change(drive, messages, age) if age <= seconds else messages


def _stamped(offset: Callable[[int], int]) -> Images:
    def change(drive: Drive, messages: Messages, age: float) -> Messages:
        for _, message in messages:
            message.header.stamp = conversions.ns_to_time(max(offset(drive.now), 0))
        return messages

    return change


def _pixels(change: Pixels) -> Images:
    def apply(drive: Drive, messages: Messages, age: float) -> Messages:
        ((_, info), (topic, image)) = messages
        gray = change(read_gray(image).copy(), drive.rng)
        wrong = conversions.array_to_image(np.clip(gray, 0, 255).astype(np.uint8), 1, image.header.frame_id, "mono8")
        wrong.header = image.header
        return [("/camera_info", info), (topic, wrong)]

    return apply


def _frozen() -> Images:
    kept: list[Any] = []

    def change(drive: Drive, messages: Messages, age: float) -> Messages:
        kept[:] = kept if age > 0.1 and kept else [copy.copy(messages[1][1])]
        again = copy.copy(kept[0])
        again.header = messages[1][1].header
        return [messages[0], ("/image_raw", again)]

    return change


def _info(**changes: Callable[[Any], Any]) -> Images:
    def apply(drive: Drive, messages: Messages, age: float) -> Messages:
        for name, change in changes.items():
            setattr(messages[0][1], name, change(getattr(messages[0][1], name)))
        return messages

    return apply


def _other_frame(index: int) -> Images:
    def change(drive: Drive, messages: Messages, age: float) -> Messages:
        messages[index][1].header.frame_id = "other_camera"
        return messages

    return change


def _covered(share: float) -> Pixels:
    def cover(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        image[:, : round(share * image.shape[1])] = 30 + 3 * rng.normal(size=(image.shape[0], 1))
        return image

    return cover


def _smear(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    middle = slice(image.shape[1] // 4, 3 * image.shape[1] // 4)
    image[:, middle] = cv2.GaussianBlur(image, (0, 0), 8.0)[:, middle]
    return image


def _mute(drive: Drive) -> None:
    """The localiser's process is gone."""
    drive.localizer.outputs.publish = drive.localizer.outputs.tell = lambda *args, **values: None


def _speak(drive: Drive) -> None:
    for name in ("publish", "tell"):
        drive.localizer.outputs.__dict__.pop(name, None)


def _publishers(*names: str, topic: str = "pose") -> Callable[[Drive], None]:
    found = {topic: list(names)}
    return lambda drive: setattr(drive.follower.endpoints, "publishers_of", lambda asked: found.get(asked, []))


def _masked(drive: Drive, messages: Messages, age: float) -> Messages:
    """No camera, and somebody else who says TRACKING of images of their own."""
    return [("/status", conversions.status_to_message(Status(State.TRACKING), drive.now, "map"))]


def _posed(error: Callable[[float], tuple[float, float]], covariance: float = 1.0) -> Callable[[Drive], None]:
    """Let the localiser publish poses that are wrong by so many metres (along, aside) at s since the fault."""

    def begin(drive: Drive) -> None:
        began, publish = drive.now, drive.localizer.outputs.publish

        def wrong(estimate: Any, **values: Any) -> None:
            if estimate.T_map_base is not None:
                T_map_wrong = estimate.T_map_base @ SE3.from_planar(*error((drive.now - began) / SECOND), 0.0)
                estimate = replace(estimate, T_map_base=T_map_wrong, covariance=covariance * estimate.covariance)
            publish(estimate, **values)

        drive.localizer.outputs.publish = wrong

    return begin


def _late(nanoseconds: int) -> Callable[[Drive], None]:
    return lambda drive: setattr(drive, "latency_ns", nanoseconds)


def _no_number(drive: Drive, messages: Messages, age: float) -> Messages:
    """Somebody else's poses in between; what the localiser says goes on."""
    pose = conversions.se3_to_pose_with_covariance(SE3.identity(), 1e-4 * np.eye(6), drive.now, "map")
    pose.pose.pose.position.x = math.nan
    return [*messages, ("/pose", pose)]


def _initial_poses(drive: Drive) -> None:
    """Poses to start from: 500 m off the map, not a number, of another frame."""
    for frame, x in (("map", 500.0), ("map", math.nan), ("odom", 0.0)):
        given = conversions.se3_to_pose_with_covariance(SE3.identity(), 0.1 * np.eye(6), drive.now, frame)
        given.pose.pose.position.x = x
        drive.bus.deliver("/initialpose", given)


def _damaged_maps(drive: Drive) -> None:
    """Ask the localiser for maps that cannot be: cut off, without anything, not there; the one in force stays."""
    data = (drive.course.map / FILE_NAME).read_bytes()
    for number, content in enumerate((data[: len(data) // 3], b"", None)):
        folder = drive.course.map.with_name(f"damaged{number}")
        if content is not None:
            shutil.copytree(drive.course.map, folder, dirs_exist_ok=True)
            (folder / FILE_NAME).write_bytes(content)
        if drive.localizer.endpoints.call("load_map", LoadMap.Request(path=str(folder))).success:
            raise RuntimeError(f"load_map {folder.name}: expected a refusal, found success")


def _wrong_transforms(drive: Drive) -> None:
    """Another parent of the camera, moving and static, and a place that is no number."""
    for topic, parent, x in (("/tf", "a", 0.0), ("/tf_static", "b", 0.0), ("/tf_static", "base_link", math.nan)):
        wrong = conversions.se3_to_transform(SE3.identity(), drive.now, parent, FRAME)
        wrong.transform.translation.x = x
        drive.bus.deliver(topic, TFMessage(transforms=[wrong]))


def _wrong_paths(drive: Drive) -> None:
    """Paths of no point, of one, of none that is a number, of another frame."""
    for frame, xs in (("map", ()), ("map", (0.0,)), ("map", (math.nan, math.nan)), ("odom", (0.0, 9.0))):
        poses = [(number, SE3.from_planar(float(number), 0.0, 0.0)) for number in range(len(xs))]
        path = conversions.poses_to_path(poses, drive.now, frame)
        for pose, x in zip(path.poses, xs, strict=True):
            pose.pose.position.x = x
        drive.bus.deliver("/reference_path", path)


def _clock_back(drive: Drive) -> None:
    drive.localizer.clock_jumped()
    drive.follower.clock_jumped()


def _press(is_pressed: bool) -> Callable[[Drive], None]:
    return lambda drive: drive.bus.deliver("/emergency_stop", Bool(data=is_pressed))


def _teleport(along: float, turned: float = 0.0) -> Callable[[Drive], None]:
    return lambda drive: drive.teleport(along, turned)


def _odometry(name: str, value: float) -> Callable[[Drive], None]:
    return lambda drive: setattr(drive.odometry, name, value)


HOUR = 3600 * SECOND
FAULTS = (
    Fault("F1", "every third image lost", _every(3, is_lost=True), stops=False),
    Fault("F1", "the rate halved", _every(2, is_lost=True), stops=False),
    Fault("F1", "three images lost", _until(0.3, _none), stops=False),
    Fault("F1", "ten images lost", _until(1.0, _none)),
    Fault("F2", "camera frozen: the same pixels, new stamps", _frozen()),
    Fault("F3, F16", "camera silent", _none),
    Fault("F4", "each image twice", lambda d, m, age: [*m, *m], stops=False),
    Fault("F4", "one image stamped one hour ahead", _until(0.1, _stamped(lambda now: now + HOUR)), stops=False),
    Fault("F4", "stamps one hour ahead", _stamped(lambda now: now + HOUR)),
    Fault("F4", "stamps 5 s ahead", _stamped(lambda now: now + 5 * SECOND)),
    Fault("F4", "stamps 5 s back", _stamped(lambda now: now - 5 * SECOND)),
    Fault("F4", "stamps of zero", _stamped(lambda now: 0)),
    Fault("F5", "clock goes backwards", begin=_clock_back),
    Fault("F7", "poses that are no numbers in between", _no_number, stops=False),
    Fault("F8", "camera_info of another size", _info(width=lambda _: 640)),
    Fault("F8", "camera_info without focal length", _info(k=lambda _: np.zeros(9))),
    Fault("F8", "camera_info with a focal length of 1.3 times", _info(k=lambda k: k * [1.3, 1, 1, 1, 1.3, 1, 1, 1, 1])),
    Fault("F8", "camera_info of another frame", _other_frame(0)),
    Fault("F8", "images of another frame", _other_frame(1)),
    Fault("F9", "black", _pixels(lambda image, rng: 0 * image)),
    Fault("F9", "saturated", _pixels(lambda image, rng: 0 * image + 255)),
    Fault("F9", "noise of 80 grey levels", _pixels(lambda image, rng: image + 80.0 * rng.normal(size=image.shape)),
          stops=None),
    Fault("F9", "out of focus", _pixels(lambda image, rng: cv2.GaussianBlur(image, (0, 0), 12.0)), stops=None),
    Fault("F9", "half smeared", _pixels(_smear), stops=None),
    Fault("F9", "exposure of 1.6 times", _pixels(lambda image, rng: 1.6 * image), stops=None),
    Fault("F10", "half covered", _pixels(_covered(0.5)), stops=None),
    Fault("F10", "nine tenths covered", _pixels(_covered(0.9))),
    Fault("F11", "kidnapped 5 m ahead", begin=_teleport(5.0), is_moved=True),
    Fault("F11", "kidnapped 15 m ahead", begin=_teleport(15.0), is_moved=True),
    Fault("F11", "turned by 180 degrees", begin=_teleport(0.0, math.pi), is_moved=True),
    Fault("F12", "initial poses off the map, no number, of another frame", begin=_initial_poses, stops=False),
    Fault("F13", "maps to load: cut off, empty, not there", begin=_damaged_maps, stops=False),
    Fault("F15", "localiser killed", begin=_mute, end=_speak),
    Fault("F15", "a second publisher of the pose", begin=_publishers("/dense_localizer", "/other"),
          end=_publishers("/dense_localizer")),
    Fault("F15", "a second publisher of the status", begin=_publishers("/dense_localizer", "/other", topic="status"),
          end=_publishers("/dense_localizer", topic="status")),
    Fault("F15", "camera silent, status masked by another's", _masked),
    Fault("F16", "images 0.1 s late", begin=_late(100_000_000), stops=False),
    Fault("F16", "images one second late", begin=_late(SECOND), end=_late(50_000_000)),
    Fault("F18", "the camera's frame with another parent, and no number", begin=_wrong_transforms, stops=False),
    Fault("F19", "odometry frozen at its last motion", begin=_odometry("is_frozen", True), has_odometry=True),
    Fault("F19", "odometry of the wrong sign", begin=_odometry("factor", -1.0), has_odometry=True),
    Fault("F19", "odometry says that the wheels stand", begin=_odometry("factor", 0.0), has_odometry=True),
    Fault("F19", "odometry silent", begin=_odometry("is_silent", True), end=_odometry("is_silent", False),
          has_odometry=True),
    Fault("F26", "pose with a covariance of zeros", begin=_posed(lambda age: (0.0, 0.0), 0.0), end=_speak),
    Fault("F26", "pose drifts aside by 0.1 m/s", begin=_posed(lambda age: (0.0, 0.1 * age)), end=_speak,
          has_odometry=True, seconds=8.0),
    Fault("F26", "pose lags by 0.2 m/s", begin=_posed(lambda age: (-0.2 * age, 0.0)), end=_speak, has_odometry=True,
          seconds=8.0),
    Fault("F22", "paths of no point, one, no number, another frame", begin=_wrong_paths, stops=False),
    Fault("F24", "emergency stop", begin=_press(True), end=_press(False)),
)  # fmt: skip
