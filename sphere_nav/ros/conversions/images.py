"""sensor_msgs/Image and CompressedImage against arrays indexed [v, u].

PNG and JPEG: the size is read from the header, so that absurd ones are refused before anything is allocated.
"""

from __future__ import annotations

import array
import struct
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image

from sphere_nav.geometry.arrays import Bytes, Floats, Size
from sphere_nav.geometry.cameras.camera import MAX_PIXELS
from sphere_nav.geometry.files.encoded import PNG_MAGIC, decode_file
from sphere_nav.geometry.plausible import SAMPLE_STEP, check_lengths
from sphere_nav.ros.conversions.headers import header

AnyImage: TypeAlias = Image | CompressedImage
ENCODINGS: dict[str, tuple[type, int]] = {  # type of what a pixel has, and how many
    **dict.fromkeys(("mono8", "8UC1", "nv12", "nv21"), (np.uint8, 1)),
    **dict.fromkeys(("bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"), (np.uint8, 1)),
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), (np.uint8, 3)),
    **dict.fromkeys(("8UC4", "rgba8", "bgra8"), (np.uint8, 4)),
    **dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv"), (np.uint8, 2)),
    **dict.fromkeys(("bayer_rggb16", "bayer_bggr16", "bayer_gbrg16", "bayer_grbg16"), (np.uint16, 1)),
    **dict.fromkeys(("mono16", "16UC1"), (np.uint16, 1)),
    "32FC1": (np.float32, 1),
}
TO_RGB = {
    "bgr8": cv2.COLOR_BGR2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,  # what OpenCV means by three channels
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "8UC4": cv2.COLOR_BGRA2RGB,
    "nv12": cv2.COLOR_YUV2RGB_NV12,
    "nv21": cv2.COLOR_YUV2RGB_NV21,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
    "bayer_rggb8": cv2.COLOR_BayerBG2RGB,  # OpenCV names a pattern by the second row's second and third pixel
    "bayer_bggr8": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGB2RGB,
}
TO_RGB |= {f"{name.removesuffix('8')}16": code for name, code in TO_RGB.items() if name.startswith("bayer")}
SENSOR_BITS = (10, 12, 14, 16)  # of a grey level that is sent in 16 bits, in the lower ones
DEPTH_ENCODINGS = ("16UC1", "32FC1")
SIXTEEN_BITS = ("16UC1", "mono16")
IN_PAIRS = ("yuv422", "uyvy", "yuv422_yuy2", "yuyv", "nv12", "nv21")  # two pixels share a colour
WITH_PLANE = ("nv12", "nv21")  # half as many rows again, of colours
COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")  # of image_transport's compressedDepth: kind, two parameters


def image_to_array(message: Image) -> NDArray[Any]:
    """Return the pixels (H, W) or (H, W, channels) in the machine's byte order, without padding; a view if possible."""
    if message.encoding not in ENCODINGS:
        raise ValueError(f"encoding: expected one of {', '.join(ENCODINGS)}, found {message.encoding!r}")
    kind, channels = ENCODINGS[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    if message.encoding in WITH_PLANE:
        if height % 2:
            raise ValueError(f"height: expected an even number of rows of {message.encoding}, found {height}")
        height += height // 2
    row = width * channels * np.dtype(kind).itemsize
    if not 0 < height * width <= MAX_PIXELS:
        raise ValueError(f"image size: expected 1 to {MAX_PIXELS} pixels, found {width} x {height}")
    if step < row:
        raise ValueError(f"step: expected at least {row} ({width} pixels of {message.encoding}), found {step}")
    if len(message.data) < step * (height - 1) + row or len(message.data) > step * height:
        raise ValueError(f"data: expected {step * height} bytes ({height} rows of {step}), found {len(message.data)}")
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    strides = step, channels * dtype.itemsize, dtype.itemsize
    pixels = np.ndarray((height, width, channels), dtype, buffer=message.data, strides=strides)
    pixels.flags.writeable = False
    return np.ascontiguousarray(pixels if channels > 1 else pixels[..., 0], dtype=kind)


def array_to_image(pixels: NDArray[Any], stamp: int, frame_id: str, encoding: str) -> Image:
    """Return an Image; `pixels` (H, W) or (H, W, channels) of the type that `encoding` names, stamp in ns."""
    kind, channels = ENCODINGS[encoding]
    height, width = pixels.shape[:2]
    return Image(
        header=header(stamp, frame_id),
        height=height,
        width=width,
        encoding=encoding,
        step=width * channels * pixels.itemsize,
        data=to_bytes(np.ascontiguousarray(pixels, dtype=np.dtype(kind).newbyteorder("<"))),
    )


class Levels:
    """The levels of one stream in eight bits: of 16 the upper eight of those that its brightest pixel so far needs."""

    def __init__(self) -> None:
        self.bits = SENSOR_BITS[0]

    def to_bytes(self, pixels: NDArray[np.uint16]) -> Bytes:
        """Return an image of the stream; a dark one keeps the scale of the bright ones before it."""
        self.bits = max(self.bits, used_bits(pixels))
        return (pixels >> (self.bits - 8)).astype(np.uint8)


def image_to_rgb(
    message: AnyImage,
    levels: Levels | None = None,
    size: Size | None = None,
    size_name: str = "camera_info",
) -> Bytes:
    """Return (H, W, 3) RGB, or (H, W) for a grey image, uint8; `levels` of its stream, else of this image alone.

    A compressed image of another size (width, height) than the camera's is not unpacked; `size_name`: whose that is.
    """
    if isinstance(message, CompressedImage):
        pixels = decode_file(message.data, MAX_PIXELS, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH, size, size_name)
        if pixels.dtype == np.uint16:
            pixels = (levels or Levels()).to_bytes(pixels)
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB) if pixels.ndim == 3 else pixels
    pixels = image_to_array(message)
    if pixels.dtype == np.uint16 and message.encoding not in DEPTH_ENCODINGS:
        pixels = (levels or Levels()).to_bytes(pixels)
    if pixels.dtype != np.uint8:
        raise ValueError(f"encoding: expected a grey or colour image, found {message.encoding!r}")
    if message.encoding in IN_PAIRS and pixels.shape[1] % 2:
        raise ValueError(f"width: expected an even number of pixels of {message.encoding}, found {pixels.shape[1]}")
    return cv2.cvtColor(pixels, TO_RGB[message.encoding]) if message.encoding in TO_RGB else pixels


def used_bits(pixels: NDArray[np.uint16]) -> int:
    """Return of how many bits the sensor is, by the highest value of an image: 10, 12, 14 or 16."""
    highest = int(pixels.max())
    return next(bits for bits in SENSOR_BITS if highest < 1 << bits)


def depth_to_meters(message: AnyImage) -> Floats:
    """Return the depth along the optical axis (H, W) float32 in m, NaN where there is none (REP-118, REP-117)."""
    if isinstance(message, CompressedImage):
        pixels, encoding = _unpack_depth(message)
    else:
        pixels, encoding = image_to_array(message), message.encoding
    if encoding in SIXTEEN_BITS:
        depth = pixels.astype(np.float32) * np.float32(1e-3)
        depth[np.isin(pixels, (0, 65535))] = np.nan
    elif encoding == "32FC1":
        depth = np.where(pixels > 0, pixels, np.float32(np.nan))
    else:
        raise ValueError(f"encoding of depth: expected 16UC1 or 32FC1, found {encoding!r}")
    check_lengths("depth", depth[::SAMPLE_STEP, ::SAMPLE_STEP], f"depth ({encoding})")
    return depth


def _unpack_depth(message: CompressedImage) -> tuple[NDArray[Any], str]:
    """Return the pixels, and their encoding, of a PNG of 16 bits, or of image_transport's compressedDepth (PNG).

    There 32FC1 is stored as a / depth + b in 16 bits, with a and b in front of the PNG; 0 is unknown.
    """
    if "compressedDepth" not in message.format:
        return _decode_16_bit(message.data), "16UC1"
    encoding = _word_of(message)
    if encoding not in DEPTH_ENCODINGS or "rvl" in message.format.lower():
        raise ValueError(
            f"format of compressed depth: expected '16UC1 or 32FC1; compressedDepth png', found {message.format!r}"
        )
    data = bytes(message.data)
    if len(data) <= COMPRESSED_DEPTH_HEADER.size:
        raise ValueError(f"data: expected a header of 12 bytes and a PNG, found {len(data)} bytes")
    _, scale, offset = COMPRESSED_DEPTH_HEADER.unpack_from(data)
    pixels = _decode_16_bit(data[COMPRESSED_DEPTH_HEADER.size :])
    if encoding == "16UC1":
        return pixels, encoding
    if not np.isfinite([scale, offset]).all():
        raise ValueError(f"data: expected finite depth parameters, found {scale}, {offset}")
    known = (pixels > 0) & (pixels != offset)
    meters = np.full(pixels.shape, np.nan, np.float32)
    meters[known] = np.float32(scale) / (pixels[known].astype(np.float32) - np.float32(offset))
    return meters, encoding


def to_bytes(pixels: NDArray[Any]) -> array.array[int]:
    """Return the memory of an array as messages take it fast: never assign an ndarray to a message."""
    data = array.array("B")
    data.frombytes(pixels.tobytes())
    return data


def is_sixteen_bit(message: CompressedImage) -> bool:
    """Whether it is a PNG of one channel of 16 bits whose format names no encoding."""
    head = bytes(message.data[:26])
    is_bare = _word_of(message).lower() in ("", "png")
    return is_bare and head.startswith(PNG_MAGIC) and head[24:] == b"\x10\x00"  # bits a channel, and which channels


def _word_of(message: CompressedImage) -> str:
    """Return the first word of a format: the encoding, or how it is compressed."""
    return str(message.format.split(";")[0].strip())


def _decode_16_bit(data: Any) -> NDArray[np.uint16]:
    pixels = decode_file(data, MAX_PIXELS, cv2.IMREAD_UNCHANGED)
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise ValueError(f"data: expected a PNG of one channel of 16 bits, found {pixels.shape} {pixels.dtype}")
    return pixels
