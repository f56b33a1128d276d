"""sensor_msgs/PointCloud2 against points (N, 3), and against the features and words of a key sphere.

A point of those is a feature: x y z its unit vector in the sphere's frame, `range` along it in metres (NaN: not known),
`word` of the map's dictionary, `descriptor` 128 bytes. A word's first feature in the map is its descriptor.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import PointCloud2, PointField

from sphere_nav.geometry.arrays import Bytes, Floats, Integers
from sphere_nav.geometry.files.untrusted import LIMITS, MAX_NUMBER
from sphere_nav.ros.conversions.headers import header
from sphere_nav.ros.conversions.images import to_bytes
from sphere_nav.spheres.appearance.features import SIZE, Features

KINDS = dict(enumerate(("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"), PointField.INT8))  # as it numbers them


def cloud_to_message(points: ArrayLike, stamp: int, frame_id: str, colors: Bytes | None = None) -> PointCloud2:
    """Return an unordered cloud of points (N, 3) in m; `colors` (N,) grey or (N, 3) RGB, as RViz shows them."""
    xyz = np.asarray(points, dtype=np.float32).reshape(-1, 3)
    table = np.zeros(len(xyz), [(name, "<f4") for name in ("x", "y", "z", *["rgb"] * (colors is not None))])
    for axis, name in enumerate("xyz"):
        table[name] = xyz[:, axis]
    if colors is not None:
        rgb = np.broadcast_to(np.asarray(colors, "<u4").reshape(len(xyz), -1), (len(xyz), 3))
        table["rgb"] = (rgb[:, 0] << 16 | rgb[:, 1] << 8 | rgb[:, 2]).view("<f4")
    return table_to_message(table, stamp, frame_id, is_dense=bool(np.isfinite(xyz).all()))


def table_to_message(table: NDArray[Any], stamp: int, frame_id: str, *, is_dense: bool = False) -> PointCloud2:
    """Return the unordered cloud whose points are the rows of a table, little-endian and without padding."""
    fields = [PointField(name=n, offset=at, datatype=kind, count=count) for n, at, kind, count in _fields(table.dtype)]
    return PointCloud2(
        header=header(stamp, frame_id),
        height=1,
        width=len(table),
        fields=fields,
        is_bigendian=False,
        point_step=table.itemsize,
        row_step=table.nbytes,
        data=to_bytes(table),
        is_dense=is_dense,
    )


def _fields(layout: np.dtype[Any]) -> list[tuple[str, int, int, int]]:
    """Return name, offset, type and count of each field of a table, as a cloud has them."""
    codes = {kind: code for code, kind in KINDS.items()}
    parts = (layout.fields or {}).items()
    return [(name, at, codes[kind.base.str[1:]], math.prod(kind.shape)) for name, (kind, at, *_) in parts]


def message_to_cloud(message: PointCloud2) -> Floats:
    """Return the points (N, 3) in m whose three coordinates are finite."""
    if not message.width * message.height:
        return np.empty((0, 3), np.float32)
    order = ">" if message.is_bigendian else "<"
    fields = {field.name: field for field in message.fields if field.datatype in KINDS}
    if not fields.keys() >= set("xyz"):
        raise ValueError(f"cloud: expected fields of numbers x, y and z, found {sorted(fields)}")
    shape, strides = (message.height, message.width), (message.row_step, message.point_step)
    size = message.row_step * message.height
    if size > LIMITS["cloud"] or message.width * message.height > LIMITS["cloud"]:
        raise ValueError(f"cloud data: expected at most {LIMITS['cloud']} bytes, found {size}")
    if len(message.data) < size or message.row_step < message.width * message.point_step:
        found = f"{len(message.data)} bytes"
        raise ValueError(f"cloud data: expected {message.height} rows of {message.row_step} bytes, found {found}")
    layout = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + KINDS[fields[axis].datatype] for axis in "xyz"],
            "offsets": [fields[axis].offset for axis in "xyz"],
            "itemsize": message.point_step,  # ValueError for a field beyond it
        }
    )
    table = np.ndarray(shape, layout, bytes(message.data), 0, strides)
    points = np.stack([table[axis].astype(np.float64).ravel() for axis in "xyz"], axis=1)
    points = points[np.isfinite(points).all(axis=1)]
    if points.size and (largest := np.abs(points).max()) > MAX_NUMBER:
        raise ValueError(f"cloud: expected coordinates up to {MAX_NUMBER:g} m, found {largest:g}")
    return points.astype(np.float32)


LAYOUT = np.dtype([*((name, "<f4") for name in ("x", "y", "z", "range")), ("word", "<u2"), ("descriptor", "u1", SIZE)])


def features_to_table(features: Features, words: Integers | int = 0) -> NDArray[Any]:
    """Return features and their words as rows of LAYOUT."""
    table = np.zeros(len(features), LAYOUT)
    table["x"], table["y"], table["z"] = features.rays.T
    table["range"], table["word"], table["descriptor"] = features.range_m, words, features.descriptors
    return table


def table_to_features(table: NDArray[Any]) -> Features:
    """Return the features of rows of LAYOUT."""
    rays = np.stack([table[name] for name in "xyz"], axis=-1)
    return Features(rays, table["range"].copy(), table["descriptor"].copy())


def features_to_message(features: Features, words: Integers, stamp: int, frame_id: str) -> PointCloud2:
    """Return the message of a key sphere's features and their words."""
    return table_to_message(features_to_table(features, words), stamp, frame_id)


def message_to_features(message: PointCloud2) -> tuple[Features, Integers]:
    """Return features and words; ValueError where the layout is another one, sizes do not fit, or a ray is none."""
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    if fields != _fields(LAYOUT) or message.point_step != LAYOUT.itemsize or message.is_bigendian:
        raise ValueError(f"features: fields: expected {list(LAYOUT.names or ())}, found {[f[0] for f in fields]}")
    number, size = message.width * message.height, len(message.data)
    if number > LIMITS["features"] or size != number * LAYOUT.itemsize:
        raise ValueError(f"features: expected {number * LAYOUT.itemsize} bytes for {number} features, found {size}")
    table = np.frombuffer(bytes(message.data), LAYOUT)
    features = table_to_features(table)
    if not np.all(np.abs(np.linalg.norm(features.rays, axis=1) - 1.0) < 1e-3):
        raise ValueError("features: x, y, z: expected unit vectors, found others")
    if np.any(features.range_m <= 0):
        raise ValueError("features: range: expected positive metres or NaN, found others")
    return features, table["word"].astype(np.int64)
