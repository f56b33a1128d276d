"""What the first messages of a topic show: frame, size and encoding, and what is wrong with every one of them.

They are read by the very conversions that the nodes use, so that what is found good here is not refused there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, LaserScan

from sphere_nav.geometry.files.encoded import encoded_size
from sphere_nav.ros import conversions
from sphere_nav.ros.conversions.driving import check_scan
from sphere_nav.ros.conversions.images import (
    COMPRESSED_DEPTH_HEADER,
    DEPTH_ENCODINGS,
    ENCODINGS,
    is_sixteen_bit,
    used_bits,
)
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


@dataclass(frozen=True)
class Shown:
    """The fields of a Stream that its messages tell."""

    frame_id: str = ""
    width: int = 0
    height: int = 0
    encoding: str = ""
    problem: str = ""
    is_projected: bool = False
    lead_ns: int = 0


def is_depth(encoding: str, topic: str) -> bool:
    """Whether the pixels of an image are distances."""
    pixels = encoding.removeprefix(COMPRESSED_WORD).split(";")[0].strip()
    has_word = pixels == "mono16" and "depth" in topic
    return pixels in DEPTH_ENCODINGS or "compressedDepth" in encoding or has_word


def examine_samples(found: Sequence[tuple[int, Any]], kind: str, topic: str) -> Shown:
    """Return what messages (time of recording in ns, message) of a type show; the first that is good counts."""
    shown = Shown()
    for _, message in found:
        one = _show(message, kind, topic)
        if not shown.encoding or not one.problem:
            shown = one
        if not one.problem:
            break
    if kind in WITH_STAMPS:
        stamps = [conversions.stamp_ns(message) for _, message in found]
        lead_ns = min(stamp - time for stamp, (time, _) in zip(stamps, found, strict=True))
        shown = replace(shown, lead_ns=max(lead_ns, 0), problem=shown.problem or _fault_of(stamps))
    return shown


def _show(message: Any, kind: str, topic: str) -> Shown:
    """Return what one message shows, with what is wrong with it."""
    frame = message.frame_id if kind == SPHERE_INFO else message.header.frame_id  # SphereInfo has no header
    if kind not in _DETAILS:
        return Shown(frame)
    details, check = _DETAILS[kind]
    shown = Shown(frame, **details(message))
    try:
        return replace(shown, **check(message, is_depth(shown.encoding, topic)))
    except ValueError as error:
        return replace(shown, problem=one_line(error))


def _fault_of(stamps: Sequence[int]) -> str:
    if not any(stamp > 0 for stamp in stamps):
        return "header.stamp: expected a time, found 0"
    is_still = len(stamps) > 1 and len(set(stamps)) == 1
    return f"header.stamp: expected one that grows, found {stamps[0] * 1e-9:.3f} s {len(stamps)} times" * is_still


def _raw_details(message: Image) -> dict[str, Any]:
    return {"width": int(message.width), "height": int(message.height), "encoding": message.encoding}


def _check_raw(message: Image, has_depth: bool) -> dict[str, Any]:
    if not has_depth:
        conversions.image_to_rgb(message)
    elif not np.isfinite(conversions.depth_to_meters(message)).any():
        raise ValueError("range or depth: expected some measured pixels, found none")
    return {}


def _compressed_details(message: CompressedImage) -> dict[str, Any]:
    data, width, height = bytes(message.data), 0, 0
    with suppress(ValueError):
        width, height = encoded_size(data[COMPRESSED_DEPTH_HEADER.size * ("compressedDepth" in message.format) :])
    encoding = f"mono16; {message.format}" if is_sixteen_bit(message) else message.format
    return {"width": width, "height": height, "encoding": f"{COMPRESSED_WORD}{encoding}"}


def _check_compressed(message: CompressedImage, has_depth: bool) -> dict[str, Any]:
    try:
        image = conversions.decompress(message)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith("format") else f"format {message.format!r}: {text}") from None
    return _check_raw(image, has_depth)


def _info_details(message: CameraInfo) -> dict[str, Any]:
    return {"width": int(message.width), "height": int(message.height), "encoding": message.distortion_model}


def _check_info(message: CameraInfo, _: bool) -> dict[str, Any]:
    """Return the size of the camera's images, binning and region counted, and whether P is one of a camera."""
    found: dict[str, Any] = {}
    with suppress(ValueError):
        camera = conversions.camera_from_info(conversions.as_rectified(message))
        found = {"is_projected": True, "width": camera.width, "height": camera.height}
    try:
        camera = conversions.camera_from_info(message)
    except ValueError as error:
        return found | {"problem": one_line(error)}
    return found | {"width": camera.width, "height": camera.height}


def _check_pixels(message: Image, has_depth: bool) -> dict[str, Any]:
    """Return the encoding, with the bits that are used of 16."""
    _check_raw(message, has_depth)
    if has_depth or ENCODINGS[message.encoding][0] is not np.uint16:
        return {}
    bits = used_bits(conversions.image_to_array(message))
    return {"encoding": f"{message.encoding}; {bits} bits used"}


def _check_scan(message: LaserScan, _: bool) -> dict[str, Any]:
    check_scan(message)
    return {}


_DETAILS: dict[str, tuple[Callable[[Any], dict[str, Any]], Callable[[Any, bool], dict[str, Any]]]] = {
    IMAGE: (_raw_details, _check_pixels),
    COMPRESSED: (_compressed_details, _check_compressed),
    CAMERA_INFO: (_info_details, _check_info),
    SCAN: (lambda message: {"encoding": f"{len(message.ranges)} beams"}, _check_scan),
}
