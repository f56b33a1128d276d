"""Images on a topic, raw or compressed by image_transport: what to subscribe to, and how to read them."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import CompressedImage, Image

from sphere_nav.geometry.arrays import Bytes, Size
from sphere_nav.ros import conversions
from sphere_nav.ros.conversions.images import AnyImage as AnyImage
from sphere_nav.ros.endpoints import COMPRESSED, COMPRESSED_DEPTH
from sphere_nav.spheres.sphere import to_gray_bytes


def image_topic(topic: str, transport: str, *, is_depth: bool = False) -> tuple[str, type[Any]]:
    """Return the topic by its transport, `raw` or `compressed`, and the kind of its messages."""
    if transport == "raw":
        return topic, Image
    return topic + (COMPRESSED_DEPTH if is_depth else COMPRESSED), CompressedImage


def read_gray(message: AnyImage, size: Size | None = None, levels: conversions.Levels | None = None) -> Bytes:
    """Return grey levels (H, W) uint8; `size` and `levels` as of `image_to_rgb`."""
    return to_gray_bytes(conversions.image_to_rgb(message, levels, size))
