"""When a message is due."""

import pytest

from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.playback import Playback

START = 5_000_000_000


class Wall:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def wall():
    return Wall()


def take_due(playback):
    taken = []
    while (item := playback.due()) is not None:
        taken.append((item.topic, item.stamp_ns - START))
        playback.take()
    return taken


def test_messages_are_due_at_the_pace_of_recording(make_bag, wall):
    with BagReader(make_bag()) as bag:
        playback = Playback(bag, ["/text", "/stamp"], START, 2.0, wall)
        assert playback.total == 80
        assert take_due(playback) == [("/text", 0)]  # /stamp is a nanosecond later
        wall.now += 0.06  # 0.12 s of the bag
        assert [stamp for _, stamp in take_due(playback)] == [1, 100_000_000, 100_000_001]
        assert playback.present_ns() == pytest.approx(START + 120_000_000, abs=10)
        wall.now += 100.0
        assert len(take_due(playback)) == 76
        assert (playback.done, playback.next, playback.present_ns()) == (80, None, 0)


def test_a_pause_is_not_made_up_for(make_bag, wall):
    with BagReader(make_bag()) as bag:
        playback = Playback(bag, ["/stamp"], START, 1.0, wall)
        take_due(playback)
        wall.now += 0.05
        playback.pause()
        wall.now += 50.0
        assert len(take_due(playback)) == 1  # the clock goes on from the next message
        wall.now += 0.1
        assert len(take_due(playback)) == 1


def test_latched_topics_come_first_and_once(make_bag, wall):
    with BagReader(make_bag()) as bag:
        playback = Playback(bag, list(bag.topics), START + 2_000_000_000, 0.0, wall)
        assert [(item.topic, item.stamp_ns) for item in playback.latched()] == [("/latched", START)]
        topics = [topic for topic, _ in take_due(playback)]
        assert topics.count("/latched") == 0
        assert len(topics) == 40
        at_start = Playback(bag, list(bag.topics), START, 0.0, wall)
        assert [item.topic for item in at_start.latched()] == ["/latched"]
        assert [topic for topic, _ in take_due(at_start)].count("/latched") == 0
