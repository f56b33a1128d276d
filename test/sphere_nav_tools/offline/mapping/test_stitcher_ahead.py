from collections import deque
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from sphere_nav_tools.offline.mapping.segments import DriveSegment
from sphere_nav_tools.offline.mapping.stitcher_ahead import StitcherAhead


def make(stitch):
    """Return a stitcher without a rig, and the list of what it publishes."""
    node, published = StitcherAhead.__new__(StitcherAhead), []
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


def test_only_what_is_of_the_segment_is_stitched():
    stitched = []

    def stitch(images, stamp, points, depths):
        stitched.append(stamp)
        return SimpleNamespace(sphere=stamp)

    node, published = make(stitch)
    node.segment = DriveSegment(1, 3, warm_ns=2, first_ns=3, last_ns=4)
    for stamp in range(1, 7):
        node.stitch(instant(stamp))
    assert stitched == published == [2, 3, 4]  # the last one with the first instant after the segment


def test_its_thread_ends_with_it():
    node, _ = make(lambda images, stamp, points, depths: SimpleNamespace(sphere=stamp))
    node.stitch(instant(1))
    node.cleanup()
    with pytest.raises(RuntimeError, match="after shutdown"):
        node.stitch(instant(2))
