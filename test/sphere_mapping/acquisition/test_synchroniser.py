"""Images of one instant: complete, late, frozen, refused."""

import numpy as np
import pytest

from sphere_mapping.acquisition.params import SynchroniserParams
from sphere_mapping.acquisition.synchroniser import Synchroniser
from typed_params import build

MS = 1_000_000


def image(seed):
    return np.random.default_rng(seed).integers(1, 255, (8, 8), dtype=np.uint8)


def make(**values):
    return Synchroniser(("a", "b"), build(SynchroniserParams, values))


def test_an_instant_is_handed_out_when_complete():
    sync = make()
    assert sync.put("a", 100 * MS, image(0), 100 * MS) == []
    [instant] = sync.put("b", 102 * MS, image(1), 102 * MS)
    assert set(instant.images) == {"a", "b"}
    assert instant.notes == {}


def test_stamps_that_differ_by_more_than_the_limit_are_two_instants():
    sync = make(slack_s=0.005)
    sync.put("a", 100 * MS, image(0), 100 * MS)
    assert sync.put("b", 110 * MS, image(1), 110 * MS) == []
    assert [set(one.images) for one in sync.take(400 * MS)] == [{"a"}, {"b"}]


@pytest.mark.parametrize(
    ("policy", "names", "fails"), [("omit", {"a"}, False), ("hold", {"a", "b"}, False), ("fail", {"a"}, True)]
)
def test_a_late_camera_is_treated_by_the_policy_and_named(policy, names, fails):
    sync = make(policy=policy)
    sync.put("a", 100 * MS, image(0), 100 * MS)
    sync.put("b", 100 * MS, image(1), 100 * MS)
    sync.put("a", 200 * MS, image(2), 200 * MS)
    assert sync.take(300 * MS) == []
    [instant] = sync.take(401 * MS)
    assert set(instant.images) == names
    assert "no image within" in instant.notes["b"]
    assert instant.is_failed == fails
    assert sync.health["b"].num_missing == 1
    assert [text.split(":")[0] for text in sync.problems()] == ["b"]


def test_a_single_frozen_camera_is_left_out_by_name():
    sync = make(frozen_after=2)
    for k in range(1, 5):
        sync.put("a", k * 100 * MS, image(k), k * 100 * MS)
        [instant] = sync.put("b", k * 100 * MS, image(99), k * 100 * MS)
    assert set(instant.images) == {"a"}
    assert instant.notes["b"].startswith("frozen: the same image 4 times")


def test_a_standing_scene_without_noise_is_not_frozen():
    sync = make(frozen_after=2)
    for k in range(1, 5):
        for name in "ab":
            found = sync.put(name, k * 100 * MS, image(99), k * 100 * MS)
    assert found[0].notes == {}


def test_repeated_and_backward_stamps_are_refused():
    sync = make()
    sync.put("a", 100 * MS, image(0), 100 * MS)
    for stamp in (100 * MS, 50 * MS, 0):
        with pytest.raises(ValueError, match="a: stamp: expected after"):
            sync.put("a", stamp, image(1), 101 * MS)
    assert sync.health["a"].num_refused == 3
