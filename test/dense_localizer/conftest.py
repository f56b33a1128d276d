import pytest

from worlds.localizer import WIDE_ROOM, MemoryMap, Run, drive, make_localizer, wide_map
from worlds.room import Room


@pytest.fixture(scope="session")
def room() -> Room:
    return WIDE_ROOM


@pytest.fixture(scope="session")
def room_map(room) -> MemoryMap:
    """A map, in which a camera was localised before: what that loads is charged to no test."""
    made = wide_map(-2.0, -1.0, 0.0, 1.0, 2.0)
    Run(room, make_localizer(made)).follow(drive(2))
    return made
