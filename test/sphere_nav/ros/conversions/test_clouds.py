"""Point clouds of any layout."""

import array
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from sphere_nav.ros.conversions import cloud_to_message, message_to_cloud
from sphere_nav.ros.conversions.clouds import features_to_message, message_to_features
from sphere_nav.spheres.appearance.features import Features


def test_a_cloud_comes_back_without_its_unknown_points(rng):
    points = rng.normal(size=(50, 3)).astype(np.float32)
    points[7, 1] = np.nan
    message = cloud_to_message(points, 3, "map")
    assert (message.width, message.height, message.point_step, message.is_dense) == (50, 1, 12, False)
    np.testing.assert_array_equal(message_to_cloud(message), np.delete(points, 7, axis=0))


def test_a_number_that_is_no_coordinate_refuses_the_cloud():
    table = np.zeros(4, np.dtype([(axis, "<f8") for axis in "xyz"]))
    table["y"][2] = -1e300
    message = PointCloud2(height=1, width=4, point_step=24, row_step=96, data=array.array("B", table.tobytes()))
    message.fields = [PointField(name=axis, offset=8 * i, datatype=8, count=1) for i, axis in enumerate("xyz")]
    with pytest.raises(ValueError, match=r"cloud: expected coordinates up to 1e\+15 m, found 1e\+300"):
        message_to_cloud(message)


def test_colors_are_packed_as_rviz_reads_them(rng):
    points, colors = rng.normal(size=(20, 3)).astype(np.float32), rng.integers(0, 255, (20, 3), np.uint8)
    message = cloud_to_message(points, 3, "map", colors)
    rgb = np.frombuffer(message.data, np.uint32).reshape(20, 4)[:, 3]
    rows = np.stack([rgb >> 16 & 255, rgb >> 8 & 255, rgb & 255], axis=1)
    np.testing.assert_array_equal(rows, colors)
    np.testing.assert_array_equal(message_to_cloud(message), points)


@pytest.mark.parametrize(("order", "kind", "datatype"), [(">", "f4", 7), ("<", "u4", 6)])
def test_another_layout(rng, order, kind, datatype):
    """Doubles, big-endian numbers, fields in another order, padding of points and rows, an ordered cloud."""
    size = int(kind[1])
    offsets = {"z": 0, "x": size, "y": 3 * size}
    form = {"names": list(offsets), "formats": [order + kind] * 3, "offsets": list(offsets.values())}
    table = np.zeros((4, 6), np.dtype(form | {"itemsize": 5 * size}))
    points = rng.normal(size=(4, 6, 3)).astype(np.float32)
    points = points if kind[0] == "f" else np.floor(20.0 + 5.0 * points)
    for axis, name in enumerate("xyz"):
        table[name] = points[..., axis]
    rows = b"".join(row.tobytes() + b"pad" for row in table)
    fields = [PointField(name=name, offset=at, datatype=datatype, count=1) for name, at in offsets.items()]
    message = PointCloud2(height=4, width=6, fields=fields, is_bigendian=order == ">", data=array.array("B", rows))
    message.point_step, message.row_step = 5 * size, 30 * size + 3
    np.testing.assert_array_equal(message_to_cloud(message), points.reshape(-1, 3))


def sample(rng, number=7, **changed):
    rays = rng.normal(size=(number, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    range_m = np.where(np.arange(number) % 3 == 0, np.nan, rng.uniform(1, 9, number))
    descriptors = rng.integers(0, 256, (number, 128), dtype=np.uint8)
    whole = Features(rays.astype(np.float32), range_m.astype(np.float32), descriptors)
    return replace(whole, **changed), np.arange(number)


def test_what_does_not_fit_or_is_no_feature_is_refused(rng):
    message = features_to_message(*sample(rng), 5, "sphere_link")
    message.width = 8
    with pytest.raises(ValueError, match="expected 1168 bytes"):
        message_to_features(message)
    for changed, reason in [
        ({"rays": np.full((7, 3), np.nan, np.float32)}, "unit vectors"),
        ({"range_m": np.full(7, -1.0, np.float32)}, "positive metres"),
    ]:
        with pytest.raises(ValueError, match=reason):
            message_to_features(features_to_message(*sample(rng, **changed), 5, "sphere_link"))


def test_a_ray_is_as_long_as_a_unit_vector_to_a_thousandth(rng):
    for length, is_taken in [(0.9995, True), (1.0005, True), (0.998, False), (1.002, False)]:
        features, words = sample(rng)
        message = features_to_message(replace(features, rays=length * features.rays), words, 5, "sphere_link")
        with nullcontext() if is_taken else pytest.raises(ValueError, match="unit vectors"):
            message_to_features(message)
