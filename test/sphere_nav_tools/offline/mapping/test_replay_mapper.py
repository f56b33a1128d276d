"""A bag, played to the mapper."""

from dataclasses import replace

import pytest

from sphere_mapping.mapper import Mapper
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav_tools.offline.mapping.replay_mapper import Recipe, replay_mapper
from worlds.room import wide_room

CAMERA = Spherical(128, 64)
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def recipe(tmp_path_factory):
    """Six spheres, the last one of a covered lens."""
    room, path = wide_room(), tmp_path_factory.mktemp("replay") / "bag"
    with BagWriter(path) as bag:
        for number in range(1, 7):
            sphere = room.sphere(SE3.from_planar(-0.8 + 0.1 * number, 0.1, 0.05 * number), CAMERA, 1)
            image = sphere.image * (number < 6)
            message = sphere_to_message(replace(sphere, image=image, stamp_ns=number * SECOND), "base_link")
            bag.write("sphere", message, number * SECOND)
    return Recipe(path, {}, {}, MapDetails())


def test_a_drive_is_mapped_and_what_was_lost_is_counted(recipe):
    drive = replay_mapper(recipe, Mapper)
    assert [track.stamp_ns // SECOND for track in drive.mapper.tracks] == [1, 2, 3, 4, 5]
    assert drive.num_lost == 1
    assert drive.mapper.origin == "base_link at the first sphere, level by the mounting"
