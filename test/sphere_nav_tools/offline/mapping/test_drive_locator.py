"""A drive localised, while it is mapped, in the map that it extends."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.params import KeySphereParams, MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.maps.reader import open_map, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping.drive_locator import DriveLocator
from worlds.room import sharp_room

pytestmark = pytest.mark.slow

PARAMS = MapperParams(key=KeySphereParams(max_parallax_whole=0.1))
CAMERA = Spherical(256, 128)
DRIVE = [SE3.from_planar(0.05 + 0.08 * k, 0.05, 0.1) for k in range(8)]


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    places = [SE3.from_planar(0.3 * k, 0.0, 0.0) for k in range(3)]
    nodes = [KeySphere(k, k, T, sharp_room().sphere(T, CAMERA, k), 3.0) for k, T in enumerate(places)]
    return save_map(tmp_path_factory.mktemp("taught") / "map", SphereGraph(nodes))


def locate(reader, *rooms):
    """Return mapper and locator after a drive through rooms, one after the other, the last one to the end."""
    locator = DriveLocator(reader)
    mapper = locator.make_mapper(PARAMS)
    mapper.first_id = 100
    for number, pose in enumerate(DRIVE):
        room = rooms[min(number, len(rooms) - 1)]
        mapper.add(replace(room.sphere(pose, CAMERA, 50 + number), stamp_ns=10**9 + number * 10**8))
    locator.close()
    return mapper, locator


def test_a_drive_that_the_map_explains_is_placed_and_adds_nothing(taught):
    with open_map(taught) as reader:
        mapper, locator = locate(reader, sharp_room())
        images = locator.images(mapper)
        assert len(images) == len(DRIVE)
        sure = [(image, pose) for image, pose in zip(images, DRIVE, strict=True) if image.located is not None]
        assert len(sure) >= 4  # the first ones are in probation
        for image, pose in sure:
            T_map_sphere = reader.graph[image.located.a].T_map_sphere @ image.located.T_a_sphere
            assert T_map_sphere.distance(pose)[0] < 0.01
            assert image.load_small().stamp_ns == image.track.stamp_ns
        assert locator.unexplained(mapper) == set()
        assert sum(one.num_images for one in locator.served.values()) == len(DRIVE)  # in probation, too


class HalfNew:
    """A room whose texture is half that of another one: tracked all around, but no camera would call it the same."""

    def sphere(self, pose, camera, stamp_ns):
        known, other = (sharp_room(seed=seed).sphere(pose, camera, stamp_ns) for seed in (7, 1))
        mixed = (known.image.astype(np.uint16) + other.image) // 2
        return replace(known, image=mixed.astype(np.uint8))


def test_a_place_that_is_tracked_but_looks_different_is_new(taught):
    with open_map(taught) as reader:
        mapper, locator = locate(reader, HalfNew())
        assert sum(image.located is not None and image.located.is_sure for image in locator.images(mapper)) >= 4
        assert locator.unexplained(mapper) == set(mapper.graph.nodes)
        assert all(0.2 < locator.lacking(image.track.stamp_ns) < 0.8 for image in locator.images(mapper))
