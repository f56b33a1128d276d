import pytest

from worlds.room import Room


@pytest.fixture(scope="session")
def room() -> Room:
    return Room()
