import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # dense_localizer_world.py, under importlib mode

from dense_localizer_world import MemoryMap, Room, make_map

from sphere_geometry import SE3


@pytest.fixture(scope="session")
def room() -> Room:
    return Room()


@pytest.fixture(scope="session")
def room_map(room) -> MemoryMap:
    return make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)])
