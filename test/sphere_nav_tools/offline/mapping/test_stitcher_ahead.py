import pickle
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from sphere_nav_tools.offline.mapping import stitcher_ahead
from sphere_nav_tools.offline.mapping.stitcher_ahead import StitcherAhead


def make(stitch, *, is_settled=False):
    """Return a stitcher without a rig, and the list of what it publishes."""
    node, published = StitcherAhead.__new__(StitcherAhead), []
    node.pool, node.coming, node._known = ThreadPoolExecutor(1), deque(), b""
    node.stitcher = SimpleNamespace(stitch=stitch, is_settled=is_settled)
    node.publish = published.append
    return node, published


def instant(stamp):
    return SimpleNamespace(images={}, sync=SimpleNamespace(stamp_ns=stamp), points=None, depths=None)


def test_a_sphere_is_published_some_instants_later():
    node, published = make(lambda images, stamp, points, depths: SimpleNamespace(sphere=stamp))
    for stamp, before in ((1, []), (2, []), (3, [1]), (4, [1, 2])):
        node.stitch(instant(stamp))
        assert published == before
    while node.coming:
        node.publish_next()
    assert published == [1, 2, 3, 4]


def test_what_cannot_be_stitched_is_told_where_its_sphere_is_due():
    def stitch(images, stamp, points, depths):
        raise ValueError("top_left: image: expected 416 x 416")

    node, published = make(stitch)
    node.stitch(instant(1))
    with pytest.raises(ValueError, match="top_left"):
        node.publish_next()
    assert published == []


def test_others_stitch_once_the_rig_is_learned(monkeypatch):
    asked = []
    monkeypatch.setattr(stitcher_ahead.LearnedRig, "of", lambda stitcher: "rig")
    monkeypatch.setattr(stitcher_ahead, "stitch_apart", lambda known, *values: asked.append((known, values[1])))
    node, _ = make(lambda images, stamp, points, depths: SimpleNamespace(sphere=stamp))
    node.executor = ThreadPoolExecutor(1)
    node.stitch(instant(1))
    node.stitcher.is_settled = True
    node.stitch(instant(2))
    assert node.coming[0].result() == 1
    assert node.coming[1].result() is None
    assert asked == [(pickle.dumps("rig"), 2)]


def test_its_thread_ends_with_it():
    node, _ = make(lambda images, stamp, points, depths: SimpleNamespace(sphere=stamp))
    node.stitch(instant(1))
    node.cleanup()
    with pytest.raises(RuntimeError, match="after shutdown"):
        node.stitch(instant(2))
