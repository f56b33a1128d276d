from collections import deque
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from sphere_nav.offline.mapping import stitcher_ahead
from sphere_nav.offline.mapping.stitcher_ahead import Scout, StitcherAhead


def make(stitch, kind=StitcherAhead):
    """Return a stitcher without a rig, and the list of what it publishes."""
    node, published = kind.__new__(kind), []
    node.pool, node.coming = ThreadPoolExecutor(1), deque()
    node.stitcher = SimpleNamespace(stitch=stitch)
    node.publish = published.append
    return node, published


def instant(stamp):
    return SimpleNamespace(images={}, sync=SimpleNamespace(stamp_ns=stamp), points=None, depths=None)


def test_a_sphere_is_published_with_the_next_instant_and_the_last_one_at_the_end():
    node, published = make(lambda images, stamp, points, depths: SimpleNamespace(sphere=stamp))
    for stamp, before in ((1, []), (2, [1]), (3, [1, 2])):
        node.stitch(instant(stamp))
        assert published == before
    node.publish_last()
    node.publish_last()  # nothing is open any more
    assert published == [1, 2, 3]


def test_what_cannot_be_stitched_is_told_where_its_sphere_is_due():
    def stitch(images, stamp, points, depths):
        raise ValueError("top_left: image: expected 416 x 416")

    node, published = make(stitch)
    node.stitch(instant(1))
    with pytest.raises(ValueError, match="top_left"):
        node.publish_last()
    assert published == []


def test_a_scout_sends_instants_elsewhere_once_nothing_more_is_learned(monkeypatch):
    scout, _ = make(None, Scout)
    stitched, sent = [], []

    def stitch(images, stamp, points, depths):
        stitched.append(stamp)
        scout.stitcher.is_settled = len(stitched) == 3
        return SimpleNamespace(sphere=stamp)

    scout.stitcher = SimpleNamespace(stitch=stitch, is_settled=False)
    scout.executor = SimpleNamespace(submit=lambda function, task: sent.append((function, task.stamp_ns, task.recipe)))
    monkeypatch.setattr(stitcher_ahead, "recipe_of", lambda stitcher: b"learned")
    for stamp in range(5):
        scout.stitch(instant(stamp))
    assert stitched == [0, 1, 2]
    assert sent == [(stitcher_ahead.stitch_task, 3, b"learned"), (stitcher_ahead.stitch_task, 4, b"learned")]
    assert [future.result() for future in list(scout.coming)[:3]] == [0, 1, 2]


def test_its_thread_ends_with_it():
    node, _ = make(lambda images, stamp, points, depths: SimpleNamespace(sphere=stamp))
    node.stitch(instant(1))
    node.cleanup()
    with pytest.raises(RuntimeError, match="after shutdown"):
        node.stitch(instant(2))
