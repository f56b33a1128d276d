"""What an input says about itself."""

from types import SimpleNamespace

from std_msgs.msg import Int32, String

from sphere_nav.ros import qos
from sphere_nav.ros.endpoints import ERROR, OK, WARN
from sphere_nav.ros.rclpy_shell import examine_input
from sphere_nav.ros.subscription import Subscription


class Log(list):
    def error(self, text, *, every=0.0, key=""):
        self.append(text)


def make(callback=lambda message: None, **options):
    return Subscription("number", Int32, callback, qos.LATCHED, log=Log(), **options)


def publisher(kind="std_msgs/msg/Int32", profile=qos.LATCHED):
    return SimpleNamespace(node_name="driver", node_namespace="/front", topic_type=kind, qos_profile=profile)


def test_a_refusal_is_counted_and_the_next_message_is_heard():
    heard = []

    def callback(message):
        if message.data == 1:
            raise ValueError("data: expected 0, found 1")
        heard.append(message.data)

    wanted = make(callback)
    for number in (0, 1, 2):
        wanted.deliver(Int32(data=number))
    assert heard == [0, 2]
    assert (wanted.num_received, wanted.num_refused) == (3, 1)
    assert wanted.log == ["number: refused: data: expected 0, found 1"]


def test_only_a_required_input_is_missing():
    assert make().is_missing
    assert not make(is_required=False).is_missing
    heard = make(silence=0.0)
    heard.deliver(Int32())
    assert not heard.is_missing
    heard.last_arrival -= 100.0
    assert not heard.is_missing  # silence=0: once is enough
    quiet = make(silence=2.0)
    quiet.deliver(Int32())
    quiet.last_arrival -= 3.0
    assert quiet.is_missing


def test_the_explanation_names_the_cause():
    wanted = make()
    name = "waiting for /number (std_msgs/msg/Int32; reliable, transient local, depth 1)"
    assert wanted.explain("/number", []) == f"{name}: no publisher"
    wrong = publisher(kind="std_msgs/msg/String")
    assert wanted.explain("/number", [wrong]) == f"{name}: /front/driver publishes std_msgs/msg/String there"
    volatile = publisher(profile=qos.STATE)
    expected = f"{name}: /front/driver is incompatible: it offers volatile, asked is transient local"
    assert wanted.explain("/number", [volatile]) == expected
    assert wanted.explain("/number", [publisher(), publisher()]) == f"{name}: 2 publishers, no message yet"
    wanted.deliver(String())
    wanted.last_arrival -= 3.0
    assert wanted.explain("/number", [publisher()]) == f"{name}: 1 publisher, no message for 3.0 s"


def test_gaps_in_the_numbers_of_one_publisher_are_losses():
    wanted = make()
    for number in (7, 8, 12, 1, 2):  # four, then the publisher starts again
        wanted.count(number, num_publishers=1)
    assert wanted.num_lost == 3
    wanted.count(50, num_publishers=2)  # two count for themselves
    wanted.count(None, num_publishers=1)
    assert wanted.num_lost == 3


def test_an_input_is_judged_by_its_counts():
    log, infos = SimpleNamespace(warning=lambda text, every, key: said.append((every, key))), []
    shell = SimpleNamespace(get_publishers_info_by_topic=lambda topic: infos, log=log)
    first = {"num_refused": 1, "num_refused_in_row": 1, "num_received": 1}
    other = publisher(profile=qos.STATE)
    for counts, publishers, level, text in [
        ({}, [], OK, "receiving"),
        ({}, [other], OK, "receiving"),  # what is received is compatible
        ({"num_received": 0}, [], OK, "optional, nothing received"),
        ({"num_received": 0}, [other], WARN, "waiting for /a"),
        ({"num_received": 0, "is_required": True}, [], WARN, "waiting for /a"),
        ({"num_refused": 4, "num_refused_in_row": 4}, [], OK, "receiving"),
        ({"num_refused": 5, "num_refused_in_row": 5}, [], ERROR, "last 5 messages refused: too late"),
        (first, [], ERROR, "last 1 messages refused: too late"),
        ({"num_lost": 7, "num_lost_lately": 2}, [], WARN, "2 messages lost in the last second"),
    ]:
        given = {"num_received": 9, "is_required": False, "last_refusal": "too late"} | counts
        wanted, infos, said = make(silence=0.0, handle=SimpleNamespace(topic_name="/a"), **given), publishers, []
        found = examine_input(shell, wanted)
        assert (found[0], found[1].startswith(text)) == (level, True)
        assert found[2] == {"received": wanted.num_received, "refused": wanted.num_refused, "lost": wanted.num_lost}
        assert wanted.num_lost_lately == 0  # told once
        assert said == ([(5.0, "waiting /a")] if text.startswith("waiting") else [])
