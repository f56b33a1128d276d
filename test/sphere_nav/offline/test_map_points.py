"""Normals of a cloud."""

import numpy as np

from sphere_mapping.params import CloudParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.offline.map_points import cloud_of
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.sphere import Sphere
from worlds.room import Room


def test_normals_point_from_the_walls_into_the_room():
    room, T = Room(), SE3.from_planar(0.5, -0.3, 0.7)
    sphere = room.sphere(T, Spherical(256, 128))
    cloud = cloud_of(KeySphere(0, 0, T, sphere), sphere, CloudParams(step=3))
    np.testing.assert_allclose(np.max(np.abs(cloud.points) / room.half, axis=1), 1.0, atol=1e-4)
    wall = np.argmax(np.abs(cloud.points) / room.half, axis=1)
    inward = -np.take_along_axis(cloud.normals * np.sign(cloud.points), wall[:, None], axis=1)[:, 0]
    assert np.mean(inward > 0.99) > 0.9  # all but the pixels along the edges of the room
    assert cloud.rgb.shape == cloud.points.shape


def test_an_edge_of_range_gives_no_normal_across_it():
    range_m = np.full((32, 64), 5.0, np.float32)
    range_m[:, 20:] = 1.0
    range_m[10, 10] = np.nan

    sphere = Sphere(np.full((32, 64), 9, np.uint8), range_m, Spherical(64, 32))
    cloud = cloud_of(KeySphere(0, 0, SE3.identity(), sphere), sphere, CloudParams(step=1))
    assert len(cloud.points) == 32 * 64 - 1
    rays = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    along = -np.sum(cloud.normals * rays, axis=1)
    lengths = np.linalg.norm(cloud.normals, axis=1)
    assert np.all((lengths < 1e-6) | (np.abs(lengths - 1) < 1e-5))
    assert along[lengths > 0.5].min() > 0.9  # a sheet across the edge would stand along the ray
