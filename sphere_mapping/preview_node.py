"""A sphere as a small picture, for those who only want to look."""

from __future__ import annotations

import cv2
from sensor_msgs.msg import CompressedImage

from node_kit import conversions
from sphere_map.sphere import Sphere

WIDTH, QUALITY = 1024, 80  # columns; of JPEG


def draw_preview(sphere: Sphere, frame_id: str) -> CompressedImage:
    """Return a small JPEG of the sphere."""
    width = min(WIDTH, sphere.image.shape[1])
    small = cv2.resize(sphere.image, (width, width // 2), interpolation=cv2.INTER_AREA)
    small = cv2.cvtColor(small, cv2.COLOR_RGB2BGR) if small.ndim == 3 else small
    data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return CompressedImage(header=conversions.header(sphere.stamp_ns, frame_id), format="jpeg", data=data)
