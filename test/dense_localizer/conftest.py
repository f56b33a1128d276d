import pytest

from sphere_nav.geometry import SE3
from worlds.localizer import MemoryMap, Run, drive, make_localizer, make_map
from worlds.room import Room, wide_room


@pytest.fixture(scope="session")
def room() -> Room:
    return wide_room()


@pytest.fixture(scope="session")
def room_map(room) -> MemoryMap:
    """A map, in which a camera was localised before: what that loads is charged to no test."""
    made = make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)])
    Run(room, make_localizer(made)).follow(drive(2))
    return made
