"""Images on a topic, raw or compressed by image_transport: what to subscribe to, and how to read them."""

from __future__ import annotations

from typing import Any, TypeAlias

from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image

from sphere_nav.geometry.arrays import Bytes
from sphere_nav.ros import conversions
from sphere_nav.ros.endpoints import COMPRESSED, COMPRESSED_DEPTH
from sphere_nav.spheres.sphere import to_gray_bytes

AnyImage: TypeAlias = Image | CompressedImage


def image_topic(topic: str, transport: str, *, is_depth: bool = False) -> tuple[str, type[Any]]:
    """Return the topic by its transport, `raw` or `compressed`, and the kind of its messages."""
    if transport == "raw":
        return topic, Image
    return topic + (COMPRESSED_DEPTH if is_depth else COMPRESSED), CompressedImage


def read_rgb(
    message: AnyImage,
    size: tuple[int, int] | None = None,
    size_name: str = "camera_info",
    levels: conversions.Levels | None = None,
) -> Bytes:
    """Return (H, W, 3) RGB or (H, W) grey, uint8; `levels` of the stream, where it is one.

    A compressed image of another size (width, height) than the camera's is not unpacked; `size_name`: whose that is.
    """
    if isinstance(message, Image):
        return conversions.image_to_rgb(message, levels)
    return conversions.compressed_to_array(message, size, size_name, levels)


def read_gray(
    message: AnyImage, size: tuple[int, int] | None = None, levels: conversions.Levels | None = None
) -> Bytes:
    """Return grey levels (H, W) uint8; `size` and `levels` as of `read_rgb`."""
    return to_gray_bytes(read_rgb(message, size, levels=levels))


def read_depth(message: AnyImage) -> NDArray[Any]:
    """Return the depth along the optical axis (H, W) float32 in m, NaN where there is none."""
    is_raw = isinstance(message, Image)
    return conversions.depth_to_meters(message if is_raw else conversions.decompress(message))
