"""The player on an offline bus: latched topics first, all in order with their clock, held by pause and by listeners."""

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.bags.player_node import BagPlayer
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions.stamps import time_to_ns

SECOND = 10**9
START = 7 * SECOND
TEXTS = [str(k) for k in range(6)]


class Played:
    """A player and what it says: the texts of its topics, and the times of its clock."""

    def __init__(self, folder, **values):
        with BagWriter(folder / "bag") as bag:
            bag.add_topic("latched", String, qos.LATCHED)
            bag.write("latched", String(data="once"), START)
            for k, text in enumerate(TEXTS):
                bag.write("text", String(data=text), START + k * SECOND)
        self.bus, self.texts, self.clock = OfflineBus(), [], []
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
    assert [text for text in played.texts if text != "once"] == TEXTS
    assert played.clock == sorted(played.clock)
    assert set(played.clock) >= {START + k * SECOND for k in range(1, 6)}


def test_a_pause_holds_and_resume_goes_on(tmp_path):
    played = Played(tmp_path, paused=True)
    played.turn()
    assert played.texts == ["once"]
    assert played.call("resume") == "playing"
    assert played.call("pause") == "paused"
    played.turn()
    assert played.texts == ["once"]
    played.call("resume")
    played.turn()
    assert played.texts[-1] == TEXTS[-1]


def test_a_loop_begins_again_and_a_start_leaves_out_what_was_before(tmp_path):
    played = Played(tmp_path, loop=True, start=3.5)
    played.turn(4)
    later = [text for text in played.texts if text != "once"]
    assert later[:4] == ["4", "5", "4", "5"]


def test_listeners_that_are_waited_for_hold_the_start_and_are_named(tmp_path):
    played = Played(tmp_path, wait_for="text:2")
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
