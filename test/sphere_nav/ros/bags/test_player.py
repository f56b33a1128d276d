"""When a message is due; on an offline bus: latched topics first, in order, held by listeners."""

from types import SimpleNamespace

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter, player_node
from sphere_nav.ros.bags.player_node import BagPlayer
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions.headers import time_to_ns

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

    def turn(self):
        for _ in range(3):
            self.hear(self.bus.advance(self.bus.now_ns + SECOND // 10))


def test_what_was_recorded_is_played_in_order_with_its_clock(tmp_path):
    played = Played(tmp_path, clock=True)
    assert played.texts == ["once"]  # before anything is due
    played.turn()
    assert played.texts == ["once", *TEXTS]
    assert played.clock == sorted(played.clock)
    assert set(played.clock) >= {START + k * SECOND for k in range(1, 6)}


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
@pytest.fixture
def playing(make_bag, monkeypatch):
    """A player of topics at a rate, and the wall's time that it sees."""
    now = [100.0]
    monkeypatch.setattr(player_node, "time", SimpleNamespace(monotonic=lambda: now[0]))
    bag = str(make_bag())
    return now, lambda topics, rate: OfflineBus().add(BagPlayer, {"bag": bag, "topics": topics, "rate": rate})


def take_due(player):
    taken = []
    while (item := player.take()) is not None:
        taken.append((item.topic, item.stamp_ns - BEGIN))
    return taken


def test_messages_are_due_at_the_pace_of_recording(playing):
    now, make = playing
    player = make("/text /stamp", 2.0)
    assert player.total == 80
    assert take_due(player) == [("/text", 0)]  # /stamp is a nanosecond later
    now[0] += 0.06  # 0.12 s of the bag
    assert [stamp for _, stamp in take_due(player)] == [1, 100_000_000, 100_000_001]
    assert player.present_ns(player.next) == pytest.approx(BEGIN + 120_000_000, abs=10)
    now[0] += 100.0
    assert len(take_due(player)) == 76
    assert (player.done, player.next) == (80, None)
