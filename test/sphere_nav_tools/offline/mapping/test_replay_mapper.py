"""A segment of a bag, played to the mapper."""

from dataclasses import replace

import pytest

pytest.importorskip("rclpy")

from sphere_mapping.mapper import Mapper
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav_tools.offline.mapping.replay_mapper import Recipe, replay_mapper
from sphere_nav_tools.offline.mapping.segments import DriveSegment
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


def test_a_whole_drive_is_its_only_segment(recipe):
    drive = replay_mapper(recipe, Mapper, is_shown=False)
    assert [track.stamp_ns // SECOND for track in drive.mapper.tracks] == [1, 2, 3, 4, 5]
    assert drive.num_lost == 1
    assert drive.mapper.origin == "base_link at the first sphere, level by the mounting"


def test_a_segment_is_mapped_from_its_warm_up_to_its_last_instant_and_keeps_its_first_one(recipe):
    segment = DriveSegment(1, 3, 2 * SECOND, 3 * SECOND, 4 * SECOND, 1 * SECOND, 9 * SECOND)
    drive = replay_mapper(recipe, Mapper, segment, is_shown=False)
    assert [track.stamp_ns // SECOND for track in drive.mapper.tracks] == [2, 3, 4]
    assert [node.stamp_ns // SECOND for node in drive.mapper.graph] == [2, 3]
    assert drive.num_lost == 0
    assert drive.mapper.graph[0].T_map_sphere.distance(SE3.identity())[0] == 0.0
    assert drive.mapper.origin == "the first sphere"


def test_what_was_lost_before_the_first_instant_is_counted_by_the_segment_before(recipe):
    segment = DriveSegment(1, 2, 5 * SECOND, 6 * SECOND, 9 * SECOND)
    assert replay_mapper(recipe, Mapper, segment, is_shown=False).num_lost == 0
    assert replay_mapper(recipe, Mapper, replace(segment, first_ns=5 * SECOND), is_shown=False).num_lost == 1
