"""When a message is due; on an offline bus: latched topics first, in order, held by pause and by listeners."""

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav.ros.bags.playback import Playback
from sphere_nav.ros.bags.player_node import BagPlayer
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions.stamps import time_to_ns

SECOND = 10**9
BEGIN = 5 * SECOND  # of the bags of `make_bag`
START = 7 * SECOND
TEXTS = [str(k) for k in range(6)]


class Played:
    """A player and what it says: the texts of its topics, and the times of its clock."""

    def __init__(self, folder, captured=None, **values):
        with BagWriter(folder / "bag") as bag:
            bag.add_topic("latched", String, qos.LATCHED)
            bag.write("latched", String(data="once"), START)
            for k, text in enumerate(TEXTS):
                bag.write("text", String(data=text), START + k * SECOND)
        self.bus, self.texts, self.clock = OfflineBus(captured), [], []
        self.node = self.bus.add(BagPlayer, {"bag": str(folder / "bag"), "rate": 0.0} | values)
        self.hear(self.bus.settle())

    def hear(self, said):
        for item in said:
            if item.topic == "/clock":
                self.clock.append(time_to_ns(item.message.clock))
            else:
                data = item.message
                text = deserialize_message(data, String) if isinstance(data, bytes) else data
                self.texts.append(text.data)

    def turn(self, count=3):
        for _ in range(count):
            self.hear(self.bus.advance(self.bus.now_ns + SECOND // 10))

    def call(self, name):
        answer = self.node.endpoints.call(name)
        assert answer.success
        return answer.message


def test_what_was_recorded_is_played_in_order_with_its_clock(tmp_path):
    played = Played(tmp_path, clock=True)
    assert played.texts == ["once"]  # before anything is due
    played.turn()
    assert played.texts == ["once", *TEXTS]
    assert played.clock == sorted(played.clock)
    assert set(played.clock) >= {START + k * SECOND for k in range(1, 6)}


def test_a_pause_holds_and_resume_goes_on(tmp_path):
    played = Played(tmp_path)
    assert played.call("pause") == "paused"
    played.turn()
    assert played.texts == ["once"]
    assert played.call("resume") == "playing"
    played.turn()
    assert played.texts[-1] == TEXTS[-1]


def test_a_start_leaves_out_what_was_before(tmp_path):
    played = Played(tmp_path, start=3.5)
    played.turn()
    assert played.texts == ["once", "4", "5"]


def test_listeners_that_are_waited_for_hold_the_start_and_are_named(tmp_path):
    played = Played(tmp_path, {"latched"}, wait_for="text")
    played.turn()
    assert played.texts == ["once"]
    assert "waiting for a listener of /text" in played.node.reports["player"][1]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"bag": "nowhere"}, "nowhere: expected a bag .*, found none"),
        ({"start": 9.0}, r"start: expected at most 5\.000 s"),
        ({"wait_for": "latched", "topics": "text"}, "latched: expected a topic that is played"),
    ],
)
def test_what_cannot_be_played_is_refused_at_once(tmp_path, values, words):
    with pytest.raises(ValueError, match=words):
        Played(tmp_path, **values)


# --- when a message is due
def take_due(playback):
    taken = []
    while (item := playback.take()) is not None:
        taken.append((item.topic, item.stamp_ns - BEGIN))
    return taken


def test_messages_are_due_at_the_pace_of_recording(make_bag):
    with BagReader(make_bag()) as bag:
        now = [100.0]
        playback = Playback(bag, ["/text", "/stamp"], BEGIN, 2.0, lambda: now[0])
        assert playback.total == 80
        assert take_due(playback) == [("/text", 0)]  # /stamp is a nanosecond later
        now[0] += 0.06  # 0.12 s of the bag
        assert [stamp for _, stamp in take_due(playback)] == [1, 100_000_000, 100_000_001]
        assert playback.present_ns() == pytest.approx(BEGIN + 120_000_000, abs=10)
        now[0] += 100.0
        assert len(take_due(playback)) == 76
        assert (playback.done, playback.next, playback.present_ns()) == (80, None, 0)


def test_a_pause_is_not_made_up_for(make_bag):
    with BagReader(make_bag()) as bag:
        now = [100.0]
        playback = Playback(bag, ["/stamp"], BEGIN, 1.0, lambda: now[0])
        take_due(playback)
        now[0] += 0.05
        playback.pause()
        now[0] += 50.0
        assert len(take_due(playback)) == 1  # the clock goes on from the next message
        now[0] += 0.1
        assert len(take_due(playback)) == 1
