import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from dense_localizer.params import LocalizerParams
from dense_localizer.references.prefetch import BackgroundTurns, PixelPrefetch, SpherePrefetch
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.photometric import Reference, prepare_reference
from sphere_nav.photometric.pixels.selection import choose_pixels, holds, image_speed
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration
NUMBER = PARAMS.max_pixels // 2
STILL = np.zeros(6)


def reference_of(room_map):
    sphere = room_map.graph[0].sphere
    return prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS)


def chosen_of(reference, T):
    return reference.level_like(PINHOLE).selections.get((PINHOLE, NUMBER))


def test_pixels_are_chosen_before_they_are_needed_and_used_when_asked(room_map):
    reference, T = reference_of(room_map), at(0.0).inverse()
    pixels = PixelPrefetch(PARAMS, is_live=False)
    pixels.begin(0, reference, T, STILL, PINHOLE, 2)
    pixels.begin(0, reference, at(1.0).inverse(), STILL, PINHOLE, 2)  # one at a time
    assert chosen_of(reference, T) is None
    pixels.use(0)  # waits
    chosen = chosen_of(reference, T)
    assert np.array_equal(chosen.T_camera_reference.matrix, T.matrix)
    assert choose_pixels(reference.level_like(PINHOLE), T, PINHOLE, NUMBER) is chosen
    pixels.begin(0, reference, T @ SE3.exp([0, 0, 0, 0, 0.01, 0]), STILL, PINHOLE, 2)  # moved too little
    pixels.use(0)
    assert chosen_of(reference, T) is chosen
    pixels.begin(0, reference, T @ SE3.exp([0, 0, 0, 0, 0, 0.1]), STILL, PINHOLE, 2)
    pixels.use(0)
    assert chosen_of(reference, T) is not chosen
    pixels.close()


def test_what_is_not_looked_at_any_more_is_forgotten(room_map):
    reference = reference_of(room_map)
    pixels = PixelPrefetch(PARAMS, is_live=False)
    pixels.begin(0, reference, at(0.0).inverse(), STILL, PINHOLE, 2)
    pixels.forget({1})
    pixels.use(0)
    assert chosen_of(reference, at(0.0).inverse()) is None
    pixels.close()


@pytest.mark.parametrize("twist", [[0, 0, 8.0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0]])
def test_what_is_chosen_ahead_serves_the_next_image_however_fast_the_camera(room_map, twist):
    reference, T, velocity = reference_of(room_map), at(0.0).inverse(), np.array(twist, float)
    pixels, level = PixelPrefetch(PARAMS, is_live=False), reference.level_like(PINHOLE)
    for chosen in pixels.choose(reference, T, PINHOLE, 2):
        chosen.keep()
    period = min(1.0 / 30.0, 0.15 / image_speed(level, velocity, PINHOLE, NUMBER))  # s, and 15 % of the width at most
    for image in range(6):
        T_now = SE3.exp(-velocity * period * image) @ T
        pixels.use(0)
        assert holds(level, T_now, PINHOLE, NUMBER)
        pixels.begin(0, reference, T_now, velocity, PINHOLE, 2)
    pixels.close()


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
    assert sum(one.num_bytes for one in preparation._ready) == 30
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
