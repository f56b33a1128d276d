"""sphere_nav_msgs/AugmentedSphere and SphereInfo against spheres with range along the ray."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import zstandard
from numpy.typing import NDArray
from sphere_nav_msgs.msg import AugmentedSphere, SphereInfo

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import MAX_SIDE
from sphere_nav.geometry.files.encoded import decode_file
from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.ros.conversions.images import to_bytes
from sphere_nav.ros.conversions.stamps import header, stamp_ns
from sphere_nav.spheres import range_codec
from sphere_nav.spheres.sphere import Sphere

# Of cv2: a search for repetitions, even for runs of one value, costs time and, where there is noise, size. Told a
# compression it would try all five filters on every row; else each pixel is told from its left neighbour, 5 ... 9 %
# larger.
PNG_SETTINGS = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
CODES_SETTINGS = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]  # runs of what is not known are long
JPEG_QUALITY = 95
ROWS = 64  # that are turned at once
COLOR = (AugmentedSphere.RGB8, AugmentedSphere.BGR8)
DEVIATION_OF_RANGE = {
    AugmentedSphere.RANGE_32FC1: AugmentedSphere.RANGE_32FC1,
    AugmentedSphere.RANGE_LOG16: AugmentedSphere.RATIO8,
    AugmentedSphere.RANGE_LOG16_PNG: AugmentedSphere.RATIO8_PNG,
    AugmentedSphere.RANGE_LOG16_ZSTD: AugmentedSphere.RATIO8_ZSTD,
}


def sphere_to_message(
    sphere: Sphere,
    frame_id: str,
    sphere_id: int = 0,
    *,
    image_encoding: str = "",
    range_encoding: str = AugmentedSphere.RANGE_LOG16,
) -> AugmentedSphere:
    """Return the message of a sphere; without `image_encoding` its bytes as they are (mono8 or rgb8)."""
    image_encoding = image_encoding or (AugmentedSphere.MONO8 if sphere.image.ndim == 2 else AugmentedSphere.RGB8)
    message = AugmentedSphere(
        header=header(sphere.stamp_ns, frame_id), info=camera_to_sphere_info(sphere.camera, frame_id)
    )
    message.id = int(sphere_id)
    message.image_encoding, message.image = image_encoding, _encode_image(sphere.image, image_encoding)
    message.range_encoding, message.range = range_encoding, _encode_range(sphere.range_m, range_encoding)
    if sphere.range_std_m is not None:
        message.range_deviation_encoding = DEVIATION_OF_RANGE[range_encoding]
        message.range_deviation = _encode_deviation(sphere, message.range_deviation_encoding)
    return message


def message_to_sphere(message: AugmentedSphere, *, is_gray: bool = False) -> Sphere:
    """Return the sphere; every size is checked before anything is allocated. Colour images are RGB.

    Where it `is_gray`, as bytes of grey and without the deviation of its range: what alignment needs.
    """
    camera = sphere_info_to_camera(message.info)
    shape = (camera.height, camera.width)
    image = _decode_image(message.image, message.image_encoding, shape, is_gray=is_gray)
    range_m = _decode_range(message.range, message.range_encoding, shape)
    if is_gray:
        return Sphere(image, range_m, camera, stamp_ns(message))
    deviation = _decode_deviation(message, range_m) if message.range_deviation_encoding else None
    return Sphere(image, range_m, camera, stamp_ns(message), deviation)


def camera_to_sphere_info(camera: Spherical, frame_id: str) -> SphereInfo:
    """Return the SphereInfo of a whole sphere or of a window of it."""
    return SphereInfo(
        projection=SphereInfo.EQUIRECTANGULAR,
        frame_id=frame_id,
        full_width=float(camera.full_width),
        full_height=float(camera.full_height),
        width=camera.width,
        height=camera.height,
        offset_u=float(camera.offset_u),
        offset_v=float(camera.offset_v),
        min_range=range_codec.MIN_RANGE,
        max_range=range_codec.MAX_RANGE,
    )


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


def _encode_image(image: NDArray[np.uint8], encoding: str) -> Any:
    is_color = image.ndim == 3
    if (encoding == AugmentedSphere.RGB8 and is_color) or (encoding == AugmentedSphere.MONO8 and not is_color):
        return to_bytes(image)
    if encoding == AugmentedSphere.BGR8 and is_color:
        return to_bytes(image[:, :, ::-1])
    options = {
        AugmentedSphere.PNG: (".png", PNG_SETTINGS),
        AugmentedSphere.JPEG: (".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]),
    }
    if encoding not in options:
        raise ValueError(f"image_encoding: expected one for shape {image.shape}, found {encoding!r}")
    suffix, settings = options[encoding]
    return to_bytes(cv2.imencode(suffix, image[:, :, ::-1] if is_color else image, settings)[1])


def _decode_image(data: Any, encoding: str, shape: tuple[int, int], *, is_gray: bool) -> NDArray[np.uint8]:
    raw = np.frombuffer(data, np.uint8)
    if encoding in (AugmentedSphere.PNG, AugmentedSphere.JPEG):
        return _decode_file(raw, shape, "image", cv2.IMREAD_GRAYSCALE if is_gray else cv2.IMREAD_UNCHANGED)
    if encoding not in (AugmentedSphere.MONO8, *COLOR):
        raise ValueError(f"image_encoding: expected mono8, rgb8, bgr8, png or jpeg, found {encoding!r}")
    full_shape = (*shape, 3) if encoding in COLOR else shape
    _check_bytes(raw.size, math.prod(full_shape), "image")
    image = raw.reshape(full_shape)
    if is_gray and encoding in COLOR:
        turn = cv2.COLOR_RGB2GRAY if encoding == AugmentedSphere.RGB8 else cv2.COLOR_BGR2GRAY
        return np.asarray(cv2.cvtColor(image, turn), np.uint8)
    if encoding == AugmentedSphere.BGR8:
        return np.ascontiguousarray(image[:, :, ::-1])
    return image if raw.flags.writeable else image.copy()


def _encode_range(range_m: NDArray[np.float32], encoding: str) -> Any:
    if encoding == AugmentedSphere.RANGE_32FC1:
        return to_bytes(np.asarray(range_m, dtype="<f4"))
    if encoding not in DEVIATION_OF_RANGE:
        raise ValueError(f"range_encoding: expected {', '.join(DEVIATION_OF_RANGE)}, found {encoding!r}")
    return _compress(range_codec.encode_ranges(range_m).astype("<u2"), encoding)


def _encode_deviation(sphere: Sphere, encoding: str) -> Any:
    assert sphere.range_std_m is not None
    if encoding == AugmentedSphere.RANGE_32FC1:
        return to_bytes(np.asarray(sphere.range_std_m, dtype="<f4"))
    return _compress(range_codec.encode_deviation(sphere.range_std_m, sphere.range_m), encoding)


def _compress(codes: NDArray[Any], encoding: str) -> Any:
    if encoding.endswith("zstd"):
        return zstandard.ZstdCompressor().compress(codes.tobytes())
    if encoding.endswith("png"):
        return to_bytes(cv2.imencode(".png", codes, CODES_SETTINGS)[1])
    return to_bytes(codes)


def _decode_range(data: Any, encoding: str, shape: tuple[int, int]) -> NDArray[np.float32]:
    if not encoding:
        return np.full(shape, np.nan, np.float32)
    if encoding == AugmentedSphere.RANGE_32FC1:
        return _known(_floats(data, shape, "range"))
    if encoding not in DEVIATION_OF_RANGE:
        raise ValueError(f"range_encoding: expected {', '.join(DEVIATION_OF_RANGE)}, found {encoding!r}")
    return range_codec.decode_ranges(_decode_codes(data, encoding, shape, "<u2", "range").astype(np.uint16, copy=False))


def _decode_deviation(message: AugmentedSphere, range_m: NDArray[np.float32]) -> NDArray[np.float32]:
    data, encoding, name = message.range_deviation, message.range_deviation_encoding, "range_deviation"
    if encoding == AugmentedSphere.RANGE_32FC1:
        return _known(_floats(data, range_m.shape, name))
    if encoding not in DEVIATION_OF_RANGE.values():
        raise ValueError(f"{name}_encoding: expected {', '.join(DEVIATION_OF_RANGE.values())}, found {encoding!r}")
    codes = _decode_codes(data, encoding, (range_m.shape[0], range_m.shape[1]), "u1", name).astype(np.uint8, copy=False)
    return range_codec.decode_deviation(codes, range_m)


def _known(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(values > 0, values, np.float32(np.nan))


def _floats(data: Any, shape: tuple[int, ...], name: str) -> NDArray[np.float32]:
    _check_bytes(len(data), 4 * math.prod(shape), name)
    return np.frombuffer(data, "<f4").reshape(shape).astype(np.float32)


def _decode_codes(data: Any, encoding: str, shape: tuple[int, int], dtype: str, name: str) -> NDArray[Any]:
    if encoding.endswith("png"):
        return _decode_file(np.frombuffer(data, np.uint8), shape, name)
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if encoding.endswith("zstd"):
        data = _decompress(data, size, name)
    _check_bytes(len(data), size, name)
    return np.frombuffer(data, dtype).reshape(shape)


def _decode_file(
    raw: NDArray[np.uint8], shape: tuple[int, int], name: str, mode: int = cv2.IMREAD_UNCHANGED
) -> NDArray[Any]:
    try:
        pixels = decode_file(raw, LIMITS["sphere"], mode, shape[::-1], "info")
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    if pixels.shape[2:] == (3,):
        for row in range(0, len(pixels), ROWS):  # in its place: a sphere in colour takes as much as all else of it
            pixels[row : row + ROWS] = cv2.cvtColor(pixels[row : row + ROWS], cv2.COLOR_BGR2RGB)
    return pixels


def _decompress(data: Any, size: int, name: str) -> bytes:
    try:
        found = zstandard.frame_content_size(data)
        if found not in (size, -1):  # -1: not told
            raise ValueError(f"{name}: expected {size} bytes after decompression, found {found}")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"{name}: expected a zstd frame: {error}") from None


def _check_bytes(found: int, expected: int, name: str) -> None:
    if found != expected:
        raise ValueError(f"{name}: expected {expected} bytes, found {found}")
