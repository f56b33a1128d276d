import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from dense_localizer.references.prefetch import BackgroundTurns, SpherePrefetch
from sphere_nav.photometric import Reference


class Sized(Reference):
    num_bytes = 10

    def __setattr__(self, name, value):
        self.__dict__[name] = value


class Reader:
    def __init__(self):
        self.read, self.fails, self.threads = [], set(), set()

    def __call__(self, sphere_id):
        self.read.append(sphere_id)
        self.threads.add(threading.current_thread().name)
        if sphere_id in self.fails:
            raise ValueError(f"sphere {sphere_id}: damaged")
        return Sized(())


def test_spheres_are_read_once_while_there_is_room():
    reader = Reader()
    preparation = SpherePrefetch(reader, 30)
    for sphere_id in (0, 1, 0, 1, 2):
        preparation.get(sphere_id)
    assert reader.read == [0, 1, 2]
    preparation.get(0)
    preparation.begin([3], lambda _: reader)  # the longest unused, 1, makes room
    preparation.get(3)
    assert preparation.num_bytes == 30
    preparation.get(0)
    assert reader.read == [0, 1, 2, 3]
    preparation.get(1)
    assert reader.read == [0, 1, 2, 3, 1]
    preparation.close()


def test_two_in_use_and_the_next_are_kept_whatever_they_take():
    reader = Reader()
    preparation = SpherePrefetch(reader, 5)
    for sphere_id in (0, 1, 0, 1):
        preparation.get(sphere_id)
    preparation.begin([0, 1, 2, 3], lambda _: reader)
    for sphere_id in (0, 1, 2):
        preparation.get(sphere_id)
    preparation.close()
    assert reader.read == [0, 1, 2]


def test_what_was_begun_is_got_without_another_reading_and_by_another_thread():
    reader = Reader()
    preparation = SpherePrefetch(reader, 100)
    assert preparation.find(4) is None
    preparation.begin([3, 4], lambda _: reader)
    assert preparation.get(4) is preparation.get(4)
    assert preparation.find(4) is preparation.get(4)
    assert reader.read == [3, 4]
    assert threading.current_thread().name not in reader.threads
    preparation.close()


def test_a_sphere_that_cannot_be_read_says_so_each_time():
    reader = Reader()
    reader.fails = {1}
    preparation = SpherePrefetch(reader, 100)
    preparation.begin([1], lambda _: reader)
    assert preparation.find(1) is None
    for _ in range(2):
        with pytest.raises(ValueError, match="sphere 1: damaged"):
            preparation.get(1)
    reader.fails = set()
    preparation.get(1)
    assert reader.read == [1, 1, 1]
    preparation.close()


def test_one_works_at_a_time_and_the_urgent_one_is_next():
    background, order = BackgroundTurns(is_limited=True), list[str]()

    def work(name, is_urgent):
        with background.wait_for_turn(is_urgent=is_urgent):
            order.append(name)

    with ThreadPoolExecutor(2) as threads:
        with background.wait_for_turn():
            patient = threads.submit(work, "patient", False)
            urgent = threads.submit(work, "urgent", True)
            while not background._num_urgent:
                time.sleep(0.001)
            assert order == []
        patient.result(20.0)
        urgent.result(20.0)
    assert order == ["urgent", "patient"]


def test_what_fails_leaves_the_turn_to_others_and_without_a_limit_all_work_at_once():
    background = BackgroundTurns(is_limited=True)
    with pytest.raises(ValueError, match="failed"), background.wait_for_turn():
        raise ValueError("failed")
    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(take_turn, background).result(20.0) == "worked"
    background = BackgroundTurns(is_limited=False)
    with ThreadPoolExecutor(1) as threads, background.wait_for_turn():
        assert threads.submit(take_turn, background).result(20.0) == "worked"


def take_turn(background):
    with background.wait_for_turn(is_urgent=True):
        return "worked"
