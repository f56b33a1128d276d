import threading

import pytest

from dense_localizer.preparation import Preparation
from photometric import Reference


class Reader:
    """Prepares nothing, and counts."""

    def __init__(self):
        self.read, self.fails, self.threads = [], set(), set()

    def __call__(self, sphere_id):
        self.read.append(sphere_id)
        self.threads.add(threading.current_thread().name)
        if sphere_id in self.fails:
            raise ValueError(f"sphere {sphere_id}: damaged")
        return Reference(())


def test_spheres_are_read_once_while_they_are_kept():
    reader = Reader()
    preparation = Preparation(reader, 2)
    for sphere_id in (0, 1, 0, 1):
        preparation.get(sphere_id)
    assert reader.read == [0, 1]
    preparation.get(2)  # the oldest, 0, makes room
    preparation.get(1)
    assert reader.read == [0, 1, 2]
    preparation.get(0)
    assert reader.read == [0, 1, 2, 0]
    preparation.close()


def test_what_was_begun_is_got_without_another_reading_and_by_another_thread():
    reader = Reader()
    preparation = Preparation(reader, 8)
    preparation.begin([3, 4])
    assert preparation.get(4) is preparation.get(4)
    assert reader.read == [3, 4]
    assert threading.current_thread().name not in reader.threads
    preparation.close()


def test_a_sphere_that_cannot_be_read_says_so_each_time():
    reader = Reader()
    reader.fails = {1}
    preparation = Preparation(reader, 8)
    preparation.begin([1])
    for _ in range(2):
        with pytest.raises(ValueError, match="sphere 1: damaged"):
            preparation.get(1)
    reader.fails = set()
    preparation.get(1)
    assert reader.read == [1, 1, 1]
    preparation.close()
