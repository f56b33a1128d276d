"""Images of one instant: complete, late, frozen, refused."""

import numpy as np
import pytest

from sphere_nav.localization.params import RigParams
from sphere_nav.ros.camera.synchronizer import Synchronizer

MAX_MISSES = 3  # written out: imported, a change would go unseen

MS = 1_000_000


def image(seed):
    return np.random.default_rng(seed).integers(1, 255, (8, 8), dtype=np.uint8)


def make(slack_s=0.005, deadline_s=0.2):
    return Synchronizer(("a", "b"), slack_s, deadline_s)


def test_an_instant_is_handed_out_when_complete_and_a_missing_stream_does_not_fill_the_memory():
    sync = make()
    assert sync.put("a", 100 * MS, image(0), 100 * MS) == []
    [instant] = sync.put("b", 102 * MS, image(1), 102 * MS)
    assert set(instant.images) == {"a", "b"}
    assert instant.notes == {}
    sync = make(deadline_s=0.2)
    for k in range(1, 101):
        sync.put("a", k * 10 * MS, image(k), k * 10 * MS)
    assert len(sync.flush()) == 20  # of 0.2 s


def test_stamps_that_differ_by_more_than_the_limit_are_two_instants_as_of_cameras_that_take_turns():
    sync = make(slack_s=0.005)
    sync.put("a", 100 * MS, image(0), 100 * MS)
    assert sync.put("b", 110 * MS, image(1), 110 * MS) == []
    assert [set(one.images) for one in sync.pop(400 * MS)] == [{"a"}, {"b"}]
    sync = make(slack_s=RigParams().slack)
    sync.put("a", 100 * MS, image(0), 100 * MS)
    assert sync.put("b", 116 * MS, image(1), 116 * MS) == []


def test_a_late_camera_is_left_out_and_named():
    sync = make()
    sync.put("a", 100 * MS, image(0), 100 * MS)
    sync.put("b", 100 * MS, image(1), 100 * MS)
    sync.put("a", 200 * MS, image(2), 200 * MS)
    assert sync.pop(300 * MS) == []
    [instant] = sync.pop(401 * MS)
    assert set(instant.images) == {"a"}
    assert "no image within" in instant.notes["b"]
    assert sync.health["b"].num_missing == 1


def five(first, second):
    """Return the last of five instants of two cameras whose k-th images these are."""
    sync = make()
    for k in range(1, 6):
        sync.put("a", k * 100 * MS, first(k), k * 100 * MS)
        [instant] = sync.put("b", k * 100 * MS, second(k), k * 100 * MS)
    return instant


def test_a_single_frozen_camera_is_left_out_by_name_but_not_a_scene_or_depth_that_stands():
    frozen = five(image, lambda k: image(99))
    assert set(frozen.images) == {"a"}
    assert frozen.notes["b"].startswith("frozen: the same image 5 times")
    assert set(five(image, lambda k: np.ones((8, 8), np.float32)).images) == {"a", "b"}
    assert five(lambda k: image(99), lambda k: image(99)).notes == {}
    alone = make()
    for k in range(1, 6):
        alone.put("b", k * 100 * MS, image(99), k * 100 * MS)
    assert all("b" in one.images for one in alone.flush())  # nobody says that it is not the scene


def test_the_nearest_instant_that_lacks_the_stream_gets_the_image_and_the_stamp_is_that_of_the_first_stream():
    sync = make(slack_s=0.02)
    sync.put("a", 100 * MS, image(0), 100 * MS)
    sync.put("a", 130 * MS, image(1), 130 * MS)
    [first, second] = sync.put("b", 125 * MS, image(2), 130 * MS)
    assert (set(first.images), set(second.images)) == ({"a"}, {"a", "b"})
    sync.put("b", 205 * MS, image(0), 200 * MS)
    [instant] = sync.put("a", 200 * MS, image(1), 200 * MS)
    assert instant.stamp_ns == 200 * MS


def test_an_instant_waits_for_what_makes_it_ready_but_not_beyond_the_deadline():
    ready = set()
    sync = Synchronizer(("a",), 0.005, 0.2, is_ready=ready.__contains__)
    assert sync.put("a", 100 * MS, image(0), 100 * MS) == []
    ready.add(100 * MS)
    assert [one.stamp_ns for one in sync.pop(101 * MS)] == [100 * MS]
    assert sync.put("a", 200 * MS, image(1), 200 * MS) == []
    assert [one.stamp_ns for one in sync.pop(401 * MS)] == [200 * MS]


def test_repeated_and_backward_stamps_are_refused():
    sync = make()
    sync.put("a", 100 * MS, image(0), 100 * MS)
    for stamp in (100 * MS, 50 * MS, 0):
        with pytest.raises(ValueError, match="a: stamp: expected after"):
            sync.put("a", stamp, image(1), 101 * MS)


class ByStamps:
    """Two cameras without a deadline."""

    def __init__(self):
        self.said, self.sync = [], Synchronizer(("a", "b"), 0.015)

    def add(self, name, stamp_ms):
        for instant in self.sync.put(name, stamp_ms * MS, stamp_ms):
            self.said.append(instant.images)
        return self.said[-1] if self.said else None


def test_the_next_instant_ends_one_that_lacks_a_camera_and_stamps_of_another_time_begin_anew():
    gate = ByStamps()
    gate.add("a", 1000)
    assert gate.add("a", 1100) == {"a": 1000}
    assert gate.add("b", 1110) == {"a": 1100, "b": 1110}
    gate.add("a", 5000)
    gate.add("b", 5000)
    gate.add("a", 1000)
    assert gate.add("b", 1000) == {"a": 1000, "b": 1000}


def test_a_camera_that_stays_away_is_not_waited_for_until_it_is_back():
    gate = ByStamps()
    for k in range(MAX_MISSES + 1):
        gate.add("a", 1000 + 100 * k)
    assert len(gate.said) == MAX_MISSES + 1  # the last one at once
    with pytest.raises(ValueError, match="b: stamp: expected after"):
        gate.add("b", 1000 + 100 * MAX_MISSES + 2)  # after its instant was handed on
    gate.add("a", 2000)
    assert gate.said[-1] != {"a": 2000}
    assert gate.add("b", 2001) == {"a": 2000, "b": 2001}
