"""What the topics of anybody's bag hold: type, frame, size and encoding, as the first messages of each show them.

They are read by the very conversions that the nodes use, so that what is found good here is not refused there. What
cannot be used, whatever its type, has a `problem` that says why.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, LaserScan

from sphere_nav.geometry.arrays import Size
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.conversions.driving import check_scan
from sphere_nav.ros.conversions.images import (
    DEPTH_ENCODINGS,
    ENCODINGS,
    AnyImage,
    is_sixteen_bit,
    used_bits,
)
from sphere_nav.ros.endpoints import base_topic
from sphere_nav.ros.service import one_line

IMAGE, COMPRESSED, CAMERA_INFO = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
)
SPHERE, SPHERE_INFO = "sphere_nav_msgs/msg/AugmentedSphere", "sphere_nav_msgs/msg/SphereInfo"
ODOMETRY, IMU, CLOUD = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "sensor_msgs/msg/PointCloud2"
SCAN = "sensor_msgs/msg/LaserScan"
WITH_FRAME = (IMAGE, COMPRESSED, CAMERA_INFO, SPHERE_INFO, SPHERE, ODOMETRY, IMU, CLOUD, SCAN)
WITH_STAMPS = (IMAGE, COMPRESSED, ODOMETRY)  # what is used at its stamp
VIDEO = (  # of which an image cannot be had without those before it
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
    "foxglove_msgs/msg/CompressedVideo",
    "theora_image_transport/msg/Packet",
)
COMPRESSED_WORD = "compressed: "  # before the format of a compressed image
NUM_SAMPLES = 5  # messages of a topic that are looked at

_READ: WeakKeyDictionary[BagReader, list[Stream]] = WeakKeyDictionary()  # of the bags that are open
Fields = Iterator[dict[str, Any]]  # of a Stream, one after the other; a ValueError ends them


@dataclass(frozen=True)
class Stream:
    """One topic of a bag, as its first messages show it; sizes are 0 and words empty where they do not say."""

    topic: str
    type: str
    count: int = 0
    rate_hz: float = 0.0
    frame_id: str = ""
    width: int = 0
    height: int = 0
    encoding: str = ""  # of an image, "compressed: <format>" of a compressed one, or the lens of a CameraInfo
    problem: str = ""  # why none of its messages can be used, in one line
    is_projected: bool = False  # a CameraInfo whose P is that of a calibrated camera
    lead_ns: int = 0  # by which its stamps are at least ahead of the recorder's clock

    @property
    def is_depth(self) -> bool:
        """Whether the pixels are distances."""
        return self.is_image and is_depth(self.encoding, self.topic)

    @property
    def is_image(self) -> bool:
        """Whether it is an image of any transport."""
        return self.type in (IMAGE, COMPRESSED)

    @property
    def is_picture(self) -> bool:
        """Whether it is an image of grey levels or colours."""
        return self.is_image and not self.is_depth

    @property
    def is_gray(self) -> bool:
        """Whether it is known to be without colour."""
        return self.encoding.startswith(("mono", "8UC1"))

    @property
    def base(self) -> str:
        """The topic without the ending of its transport."""
        return base_topic(self.topic)

    @property
    def size(self) -> Size:
        """Width and height in pixels."""
        return self.width, self.height


def read_streams(bag: BagReader) -> list[Stream]:
    """Return what the bag offers, in the order of the names; BagError for a damaged bag."""
    if bag not in _READ:
        first, last = bag.time_range
        offered = (info for _, info in sorted(bag.topics.items()) if info.count)
        _READ[bag] = []
        for info in offered:
            samples = islice(bag.messages([info.name]), NUM_SAMPLES) if info.type in WITH_FRAME else ()
            shown = examine_samples([(item.stamp_ns, item.message) for item in samples], info.type, info.name)
            rate_hz = (info.count - 1) / ((last - first) * 1e-9) if last > first else 0.0
            _READ[bag].append(replace(shown, count=info.count, rate_hz=rate_hz))
    return _READ[bag]


def examine_samples(found: Sequence[tuple[int, Any]], kind: str, topic: str) -> Stream:
    """Return what messages (time of recording in ns, message) of a type show; the first that is good counts."""
    shown = Stream(topic, kind)
    for _, message in found:
        one = _show(message, kind, topic)
        if not shown.encoding or not one.problem:
            shown = one
        if not one.problem:
            break
    if kind in WITH_STAMPS and found:
        lead_ns = min(conversions.stamp_ns(message) - time for time, message in found)
        fault = _fault_of([conversions.stamp_ns(message) for _, message in found])
        shown = replace(shown, lead_ns=max(lead_ns, 0), problem=shown.problem or fault)
    return shown


def _show(message: Any, kind: str, topic: str) -> Stream:
    """Return what one message shows, with what is wrong with it."""
    frame = message.frame_id if kind == SPHERE_INFO else message.header.frame_id  # SphereInfo has no header
    shown = Stream(topic, kind, frame_id=frame)
    try:
        for told in _EXAMINE[kind](message, topic) if kind in _EXAMINE else ():
            shown = replace(shown, **told)
    except ValueError as error:
        shown = replace(shown, problem=one_line(error))
    return shown


def is_depth(encoding: str, topic: str) -> bool:
    """Whether the pixels of an image are distances."""
    pixels = encoding.removeprefix(COMPRESSED_WORD).split(";")[0].strip()
    has_word = pixels == "mono16" and "depth" in topic
    return pixels in DEPTH_ENCODINGS or "compressedDepth" in encoding or has_word


def _fault_of(stamps: Sequence[int]) -> str:
    if not any(stamp > 0 for stamp in stamps):
        return "header.stamp: expected a time, found 0"
    is_still = len(stamps) > 1 and len(set(stamps)) == 1
    return f"header.stamp: expected one that grows, found {stamps[0] * 1e-9:.3f} s {len(stamps)} times" * is_still


def _examine_image(message: Image, topic: str) -> Fields:
    """Yield size and encoding, then the encoding with the bits that are used of 16."""
    yield {"width": int(message.width), "height": int(message.height), "encoding": message.encoding}
    has_depth = is_depth(message.encoding, topic)
    _size_of(message, has_depth=has_depth)
    if not has_depth and ENCODINGS[message.encoding][0] is np.uint16:
        yield {"encoding": f"{message.encoding}; {used_bits(conversions.image_to_array(message))} bits used"}


def _size_of(message: AnyImage, *, has_depth: bool) -> Size:
    """Return width and height; ValueError for what cannot be used."""
    pixels = conversions.depth_to_meters(message) if has_depth else conversions.image_to_rgb(message)
    if has_depth and not np.isfinite(pixels).any():
        raise ValueError("range or depth: expected some measured pixels, found none")
    return pixels.shape[1], pixels.shape[0]


def _examine_compressed(message: CompressedImage, topic: str) -> Fields:
    encoding = COMPRESSED_WORD + "mono16; " * is_sixteen_bit(message) + message.format
    yield {"encoding": encoding}
    try:
        width, height = _size_of(message, has_depth=is_depth(encoding, topic))
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith("format") else f"format {message.format!r}: {text}") from None
    yield {"width": width, "height": height}


def _examine_info(message: CameraInfo, _: str) -> Fields:
    """Yield the size of the camera's images, binning and region counted, and whether P is one of a camera."""
    yield {"width": int(message.width), "height": int(message.height), "encoding": message.distortion_model}
    with suppress(ValueError):
        camera = conversions.camera_from_info(conversions.as_rectified(message))
        yield {"is_projected": True, "width": camera.width, "height": camera.height}
    camera = conversions.camera_from_info(message)
    yield {"width": camera.width, "height": camera.height}


def _examine_scan(message: LaserScan, _: str) -> Fields:
    yield {"encoding": f"{len(message.ranges)} beams"}
    check_scan(message)


_EXAMINE: dict[str, Callable[[Any, str], Fields]] = {
    IMAGE: _examine_image,
    COMPRESSED: _examine_compressed,
    CAMERA_INFO: _examine_info,
    SCAN: _examine_scan,
}
