import threading

import numpy as np

from dense_localizer.params import LocalizerParams
from dense_localizer.pixels_ahead import PixelsAhead
from photometric import prepare_reference
from photometric.selection import choose
from sphere_geometry import SE3
from typed_params import build
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration
NUMBER = PARAMS.max_pixels // 2


def reference_of(room_map):
    sphere = room_map.graph[0].sphere
    return prepare_reference(sphere.grey, sphere.range_m, sphere.camera, PARAMS)


def chosen_of(reference, T):
    return reference.level_like(PINHOLE).selections.get((PINHOLE, NUMBER))


def test_pixels_are_chosen_before_they_are_needed_and_used_when_asked(room_map):
    reference, T = reference_of(room_map), at(0.0).inverse()
    pixels = PixelsAhead(PARAMS, is_live=False)
    pixels.begin(0, reference, T, PINHOLE, 2)
    pixels.begin(0, reference, at(1.0).inverse(), PINHOLE, 2)  # one at a time
    assert chosen_of(reference, T) is None
    pixels.use(0)  # waits
    chosen = chosen_of(reference, T)
    assert np.array_equal(chosen.T_camera_reference.matrix, T.matrix)
    assert choose(reference.level_like(PINHOLE), T, PINHOLE, NUMBER) is chosen
    pixels.begin(0, reference, T @ SE3.exp([0, 0, 0, 0, 0.01, 0]), PINHOLE, 2)  # moved too little
    pixels.use(0)
    assert chosen_of(reference, T) is chosen
    pixels.begin(0, reference, T @ SE3.exp([0, 0, 0, 0, 0, 0.1]), PINHOLE, 2)
    pixels.use(0)
    assert chosen_of(reference, T) is not chosen
    pixels.close()


def test_a_live_camera_uses_what_is_there(room_map):
    reference, T, gate = reference_of(room_map), at(0.0).inverse(), threading.Event()
    pixels = PixelsAhead(PARAMS, is_live=True)
    blocker = pixels._thread.submit(gate.wait, 20.0)
    pixels.begin(0, reference, T, PINHOLE, 2)
    pixels.use(0)
    assert chosen_of(reference, T) is None
    gate.set()
    assert blocker.result()
    pixels._pending[0].result(20.0)
    pixels.use(0)
    assert chosen_of(reference, T) is not None
    pixels.close()


def test_what_is_not_looked_at_any_more_is_forgotten(room_map):
    reference = reference_of(room_map)
    pixels = PixelsAhead(PARAMS, is_live=False)
    pixels.begin(0, reference, at(0.0).inverse(), PINHOLE, 2)
    pixels.forget({1})
    pixels.use(0)
    assert chosen_of(reference, at(0.0).inverse()) is None
    pixels.close()
