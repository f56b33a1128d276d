"""A drive is cut by what it holds, in segments that share an instant."""

from itertools import pairwise

import pytest

pytest.importorskip("rclpy")


from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav_tools.offline.mapping import segments
from sphere_nav_tools.offline.mapping.segments import END_NS, LEAD_NS, WARM_UP, DriveSegment, cut
from worlds.recordings import PERIOD_NS, START_NS, stamp, truth, write_bag

TOPIC = "/ground_truth/pose"


def cut_of(path, size, monkeypatch):
    monkeypatch.setattr(segments, "SEGMENT", size)
    with BagReader(path) as bag:
        return cut(bag, TOPIC)


def test_each_segment_begins_with_the_instant_that_the_one_before_ends_with(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "bag", truth, numbers=range(40))
    found = cut_of(path, 10, monkeypatch)
    assert [one.number for one in found] == [0, 1, 2, 3]
    assert [one.is_first for one in found] == [True, False, False, False]
    assert [one.is_last for one in found] == [False, False, False, True]
    assert found[0].first_ns == 0
    assert found[-1].last_ns == END_NS
    for before, after in pairwise(found):
        assert before.last_ns == after.first_ns
        assert (after.first_ns - START_NS) % PERIOD_NS == 0
        assert 8 * PERIOD_NS <= before.last_ns - max(before.first_ns, START_NS) <= 12 * PERIOD_NS
        assert WARM_UP * PERIOD_NS <= after.first_ns - after.warm_ns < (WARM_UP + 1) * PERIOD_NS
        assert after.begin_ns == after.warm_ns - LEAD_NS  # it was recorded when it was stamped
        assert before.end_ns > before.last_ns
    assert found[0].begin_ns is None
    assert found[-1].end_ns is None


def test_two_or_four_workers_end_together_and_segments_are_of_like_length():
    assert [segments.number_of(count) for count in (1, 149, 151, 249, 251, 410, 549)] == [1, 1, 2, 2, 4, 4, 4]
    for count in range(251, 5000):
        number = segments.number_of(count)
        assert number % 4 == 0
        assert 60 <= count / number <= 140


def test_a_short_drive_is_one_segment(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "bag", truth, numbers=range(14))
    assert cut_of(path, 10, monkeypatch) == [DriveSegment()]
    assert DriveSegment().is_first
    assert DriveSegment().is_last


def test_stamps_that_go_back_are_not_cut(tmp_path, monkeypatch):
    with BagWriter(tmp_path / "bag") as bag:
        for number in range(40):
            ((topic, message),) = truth(39 - number)
            bag.add_topic(topic, type(message))
            bag.write(topic, message, stamp(number))
    assert cut_of(tmp_path / "bag", 10, monkeypatch) == [DriveSegment()]
