"""sensor_msgs/PointCloud2 against the features and words of a key sphere.

A point is a feature: x y z its unit vector in the sphere's frame, `range` along it in metres (NaN: not known), `word`
of the map's dictionary, `descriptor` 128 bytes. A word's first feature in the map is its descriptor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.ros.conversions.images import to_bytes
from sphere_nav.ros.conversions.stamps import header
from sphere_nav.spheres.appearance.features import SIZE, Features

LAYOUT = np.dtype([("ray", "<f4", 3), ("range", "<f4"), ("word", "<u2"), ("descriptor", "u1", SIZE)])
FIELDS = (
    ("x", 0, PointField.FLOAT32, 1),
    ("y", 4, PointField.FLOAT32, 1),
    ("z", 8, PointField.FLOAT32, 1),
    ("range", 12, PointField.FLOAT32, 1),
    ("word", 16, PointField.UINT16, 1),
    ("descriptor", 18, PointField.UINT8, SIZE),
)


def features_to_message(features: Features, words: NDArray[np.int64], stamp: int, frame_id: str) -> PointCloud2:
    """Return the message of a key sphere's features and their words."""
    table = np.zeros(len(features), LAYOUT)
    table["ray"], table["range"] = features.rays, features.range_m
    table["word"], table["descriptor"] = words, features.descriptors
    fields = [PointField(name=name, offset=at, datatype=kind, count=count) for name, at, kind, count in FIELDS]
    return PointCloud2(
        header=header(stamp, frame_id),
        height=1,
        width=len(table),
        fields=fields,
        point_step=LAYOUT.itemsize,
        row_step=LAYOUT.itemsize * len(table),
        data=to_bytes(table.view(np.uint8)),
        is_dense=False,
    )


def message_to_features(message: PointCloud2) -> tuple[Features, NDArray[np.int64]]:
    """Return features and words; ValueError where the layout is another one, sizes do not fit, or a ray is none."""
    fields = tuple((field.name, field.offset, field.datatype, field.count) for field in message.fields)
    if fields != FIELDS or message.point_step != LAYOUT.itemsize or message.is_bigendian:
        raise ValueError(f"features: fields: expected {[entry[0] for entry in FIELDS]}, found {[f[0] for f in fields]}")
    number, size = message.width * message.height, len(message.data)
    if number > LIMITS["features"] or size != number * LAYOUT.itemsize:
        raise ValueError(f"features: expected {number * LAYOUT.itemsize} bytes for {number} features, found {size}")
    table = np.frombuffer(bytes(message.data), LAYOUT)
    if not np.all(np.abs(np.linalg.norm(table["ray"], axis=1) - 1.0) < 1e-3):
        raise ValueError("features: x, y, z: expected unit vectors, found others")
    if np.any(table["range"] <= 0):
        raise ValueError("features: range: expected positive metres or NaN, found others")
    return Features(table["ray"].copy(), table["range"].copy(), table["descriptor"].copy()), table["word"].astype(
        np.int64
    )
