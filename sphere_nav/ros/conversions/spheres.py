"""sphere_nav_msgs/AugmentedSphere and SphereInfo against spheres with range along the ray."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from sphere_nav_msgs.msg import AugmentedSphere, SphereInfo

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.cameras.camera import MAX_SIDE
from sphere_nav.geometry.files.encoded import decode_file
from sphere_nav.geometry.files.untrusted import LIMITS, told_at
from sphere_nav.ros.conversions.headers import header, stamp_ns
from sphere_nav.ros.conversions.images import to_bytes
from sphere_nav.ros.conversions.status import told
from sphere_nav.spheres import range_codec
from sphere_nav.spheres.sphere import Sphere

# Of cv2: a search for repetitions, even for runs of one value, costs time and, where there is noise, size. Told a
# compression it would try all five filters on every row; else each pixel is told from its left neighbour, 5 ... 9 %
# larger.
PNG_SETTINGS = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
MODES = {2: AugmentedSphere.MONO8, 3: AugmentedSphere.RGB8}  # by the axes of an image


def sphere_to_message(sphere: Sphere, frame_id: str, sphere_id: int = 0, *, is_png: bool = False) -> AugmentedSphere:
    """Return the message of a sphere, the bytes of its image as they are (mono8 or rgb8), or as a PNG file."""
    message = AugmentedSphere(
        header=header(sphere.stamp_ns, frame_id), info=camera_to_sphere_info(sphere.camera, frame_id)
    )
    message.id, image = int(sphere_id), sphere.image
    message.image_encoding, message.image = MODES[image.ndim], to_bytes(image)
    if is_png:
        message.image_encoding, bgr = AugmentedSphere.PNG, image[:, :, ::-1] if image.ndim == 3 else image
        message.image = to_bytes(cv2.imencode(".png", bgr, PNG_SETTINGS)[1])
    message.range_encoding = AugmentedSphere.RANGE_LOG16
    message.range = to_bytes(range_codec.encode_ranges(sphere.range_m).astype("<u2"))
    if sphere.range_std_m is not None:
        message.range_deviation_encoding = AugmentedSphere.RATIO8
        message.range_deviation = to_bytes(range_codec.encode_deviation(sphere.range_std_m, sphere.range_m))
    return message


def message_to_sphere(message: AugmentedSphere, *, is_gray: bool = False) -> Sphere:
    """Return the sphere; every size is checked before anything is allocated. Colour images are RGB.

    Where it `is_gray`, as bytes of grey and without the deviation of its range: what alignment needs.
    """
    camera = sphere_info_to_camera(message.info)
    shape = (camera.height, camera.width)
    image = _decode_image(message.image, message.image_encoding, shape, is_gray=is_gray)
    range_m, deviation = np.full(shape, np.nan, np.float32), None
    if message.range_encoding:
        codes = _decode_plane(message, "range", AugmentedSphere.RANGE_LOG16, "<u2", shape)
        range_m = range_codec.decode_ranges(codes.astype(np.uint16, copy=False))
    if message.range_deviation_encoding and not is_gray:
        codes = _decode_plane(message, "range_deviation", AugmentedSphere.RATIO8, "u1", shape)
        deviation = range_codec.decode_deviation(codes, range_m)
    return Sphere(image, range_m, camera, stamp_ns(message), deviation)


def camera_to_sphere_info(camera: Spherical, frame_id: str) -> SphereInfo:
    """Return the SphereInfo of a whole sphere or of a window of it."""
    info = SphereInfo(projection=SphereInfo.EQUIRECTANGULAR, frame_id=frame_id)
    info.min_range, info.max_range = range_codec.MIN_RANGE, range_codec.MAX_RANGE
    return told(info, camera)


def sphere_info_to_camera(info: SphereInfo) -> Spherical:
    """Return the camera; ValueError for another projection, absurd sizes, or a window that is not inside the sphere."""
    if info.projection != SphereInfo.EQUIRECTANGULAR:
        raise ValueError(f"info.projection: expected {SphereInfo.EQUIRECTANGULAR!r}, found {info.projection!r}")
    full = (float(info.full_width), float(info.full_height))
    if not 2 <= full[0] <= MAX_SIDE or full[0] != 2 * full[1]:
        raise ValueError(f"info.full_width: expected 2 * full_height, at most {MAX_SIDE}, found {full[0]} x {full[1]}")
    width, height = int(info.width), int(info.height)
    if not 1 <= width <= full[0] or not 1 <= height <= full[1] or width * height > LIMITS["sphere"]:
        raise ValueError(f"info.width, height: expected up to {full[0]} x {full[1]}, found {width} x {height}")
    offset_u, offset_v = float(info.offset_u), float(info.offset_v)
    if not (math.isfinite(offset_u) and abs(offset_u) <= full[0] and -1.0 < offset_v < full[1] - height + 1.0):
        raise ValueError(f"info.offset_u, offset_v: expected a window of the sphere, found {offset_u}, {offset_v}")
    return Spherical(width, height, full[0], offset_u, offset_v)


def _decode_image(data: Any, encoding: str, shape: tuple[int, int], *, is_gray: bool) -> Bytes:
    raw = np.frombuffer(data, np.uint8)
    if encoding == AugmentedSphere.PNG:
        mode = cv2.IMREAD_GRAYSCALE if is_gray else cv2.IMREAD_UNCHANGED
        with told_at("image"):
            pixels: Any = decode_file(raw, LIMITS["sphere"], mode, shape[::-1], "info")
        found: Bytes = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB) if pixels.shape[2:] == (3,) else pixels
        return found
    if encoding not in MODES.values():
        raise ValueError(f"image_encoding: expected mono8, rgb8 or png, found {encoding!r}")
    is_color = encoding == AugmentedSphere.RGB8
    full_shape = (*shape, 3) if is_color else shape
    _check_bytes(raw.size, math.prod(full_shape), "image")
    image = raw.reshape(full_shape)
    if is_gray and is_color:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    return image if raw.flags.writeable else image.copy()


def _decode_plane(
    message: AugmentedSphere, name: str, expected: str, dtype: str, shape: tuple[int, int]
) -> NDArray[Any]:
    """Return the codes (H, W) of the field of a name; ValueError for another encoding or size."""
    data, encoding = getattr(message, name), getattr(message, f"{name}_encoding")
    if encoding != expected:
        raise ValueError(f"{name}_encoding: expected {expected}, found {encoding!r}")
    _check_bytes(len(data), math.prod(shape) * np.dtype(dtype).itemsize, name)
    return np.frombuffer(data, dtype).reshape(shape)


def _check_bytes(found: int, expected: int, name: str) -> None:
    if found != expected:
        raise ValueError(f"{name}: expected {expected} bytes, found {found}")
