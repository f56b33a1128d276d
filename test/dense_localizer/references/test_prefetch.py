import threading
from unittest.mock import Mock

import numpy as np
import pytest

from dense_localizer.params import LocalizerParams
from dense_localizer.references import prefetch
from dense_localizer.references.prefetch import PixelPrefetch, SpherePrefetch
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.photometric import Reference, prepare_reference
from sphere_nav.photometric.pixels.pyramid import level_cameras
from sphere_nav.photometric.pixels.reference import choose_pixels
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration
NUMBER = PARAMS.max_pixels // 2


def reference_of(room_map):
    sphere = room_map.graph[0].sphere
    return prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS)


def test_pixels_of_all_levels_are_chosen_ahead_once_the_image_moves_by_a_twentieth_of_its_width(room_map):
    reference, T = reference_of(room_map), at(0.0).inverse()
    pixels, level = PixelPrefetch(PARAMS, is_live=False), reference.level_like(PINHOLE)
    chosen = []
    for turn in (0.0, 0.01, 0.1):
        pixels.begin([(reference, SE3.exp([0, 0, 0, 0, turn, 0]) @ T, NUMBER)], PINHOLE)
        pixels.wait()
        chosen.append(level.selections[PINHOLE, NUMBER])
    pixels.close()
    assert np.array_equal(chosen[0].T_camera_reference.matrix, T.matrix)
    assert chosen[1] is chosen[0]
    assert chosen[2] is choose_pixels(level, SE3.exp([0, 0, 0, 0, 0.1, 0]) @ T, PINHOLE, NUMBER) is not chosen[0]
    assert (PINHOLE.halve(), NUMBER) in reference.level_like(PINHOLE.halve()).selections


def test_a_live_camera_waits_for_no_choice_and_one_is_made_after_the_other(room_map, monkeypatch):
    may_choose, asked = threading.Event(), []
    monkeypatch.setattr(prefetch, "renew_selection", lambda *_: (asked.append(1), may_choose.wait(2.0)))
    wanted = [(reference_of(room_map), at(0.0).inverse(), NUMBER)]
    pixels = PixelPrefetch(PARAMS, is_live=True)
    for _ in range(3):
        pixels.begin(wanted, PINHOLE)
        pixels.wait()
    may_choose.set()
    pixels._last.result(20.0)
    pixels.close()
    assert len(asked) == len(level_cameras(PINHOLE, PARAMS.pyramid.num_levels, PARAMS.pyramid.min_side))


def test_what_fails_while_pixels_are_chosen_is_told_to_who_asks_next(room_map, monkeypatch):
    monkeypatch.setattr(prefetch, "renew_selection", Mock(side_effect=MemoryError))
    pixels = PixelPrefetch(PARAMS, is_live=True)
    pixels.begin([(reference_of(room_map), at(0.0).inverse(), NUMBER)], PINHOLE)
    assert pixels._last.exception(20.0)
    pixels.close()
    with pytest.raises(MemoryError):
        pixels.begin([], PINHOLE)


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
    preparation.begin([3])  # the longest unused, 1, makes room
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
    preparation.begin([0, 1, 2, 3])
    for sphere_id in (0, 1, 2):
        preparation.get(sphere_id)
    preparation.close()
    assert reader.read == [0, 1, 2]


def test_what_was_begun_is_got_without_another_reading_and_by_another_thread():
    reader = Reader()
    preparation = SpherePrefetch(reader, 100)
    assert preparation.find(4) is None
    preparation.begin([3, 4])
    assert preparation.get(4) is preparation.get(4)
    assert preparation.find(4) is preparation.get(4)
    assert reader.read == [3, 4]
    assert threading.current_thread().name not in reader.threads
    preparation.close()


def test_a_sphere_that_cannot_be_read_says_so_each_time():
    reader = Reader()
    reader.fails = {1}
    preparation = SpherePrefetch(reader, 100)
    preparation.begin([1])
    assert preparation.find(1) is None
    for _ in range(2):
        with pytest.raises(ValueError, match="sphere 1: damaged"):
            preparation.get(1)
    reader.fails = set()
    preparation.get(1)
    assert reader.read == [1, 1, 1]
    preparation.close()
