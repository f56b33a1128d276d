"""A replay calls the very callbacks of the nodes, in order, the same way every time."""

import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagError, BagReader, BagWriter
from sphere_nav.ros.bags.replay import OfflineBus, record, replay
from sphere_nav.ros.conversions import header
from sphere_nav.ros.node import ManagedNode


@parameters
class EchoParams:
    prefix: str = param("", "put before every text")
    period: float = param(1.0, "time between two ticks", "s", low=0.01)


class Echo(ManagedNode):
    NAME = "echo"
    PARAMS = EchoParams
    params: EchoParams

    def configure(self):
        self.heard, self.ticks, self.closed = [], [], False
        self.output = self.add_publisher("echo", String, qos.LATCHED)
        self.add_subscription("text", String, self.on_text)
        self.add_subscription("optional", String, self.on_text, is_required=False)
        self.add_timer(self.params.period, lambda: self.ticks.append(self.now_ns()))
        self.add_service("count", Trigger, self.on_count)

    def cleanup(self):
        self.closed = True

    def on_text(self, message):
        if message.data.startswith("7 "):
            raise ValueError("data: expected another number, found 7")
        self.heard.append(self.now_ns())
        self.output.publish(String(data=self.params.prefix + message.data.split()[0]))

    def on_count(self, request, response):
        response.success, response.message = True, str(len(self.heard))
        return response


class Counter(ManagedNode):
    NAME = "counter"

    def configure(self):
        self.output = self.add_publisher("count", Header)
        self.num = 0
        self.add_subscription("echo", String, self.on_echo)

    def on_echo(self, message):
        self.num += 1
        self.output.publish(Header(frame_id=f"{self.num}:{message.data}"))


def run(path, **values):
    bus = OfflineBus()
    echo, counter = bus.add(Echo, values), bus.add(Counter)
    with BagReader(path) as bag:
        return list(replay(bag, bus)), echo, counter, bus


def test_callbacks_come_in_order_with_the_recorded_time_and_what_is_refused_is_counted(make_bag):
    published, echo, counter, bus = run(make_bag(), prefix="n")
    assert echo.heard == [5_000_000_000 + n * 100_000_000 for n in range(40) if n != 7]
    texts = [item.message.data for item in published if item.topic == "/echo"]
    assert texts == [f"n{n}" for n in range(40) if n != 7]
    assert [item.topic for item in published[:4]] == ["/echo", "/count", "/echo", "/count"]
    assert published[2].stamp_ns == 5_100_000_000
    assert counter.num == 39
    assert (echo.inputs[0].num_received, echo.inputs[0].num_refused) == (40, 1)
    assert echo.inputs[0].last_refusal == "data: expected another number, found 7"
    assert echo.endpoints.call("count").message == "39"
    bus.close()
    assert echo.closed


def test_two_replays_are_equal_to_the_bit(make_bag):
    path = make_bag()
    runs = [[(t, s, serialize_message(m)) for t, s, m in run(path, period=0.03)[0]] for _ in range(2)]
    assert runs[0] == runs[1]
    assert len(runs[0]) == 78


def test_timers_fire_on_the_clock_of_the_recording(make_bag):
    _, echo, _, _ = run(make_bag(), period=0.25)
    assert echo.ticks == [5_000_000_000 + 250_000_000 * n for n in range(1, 16)]  # 3.9 s


@pytest.mark.parametrize(("lead_ms", "shift_ms"), [(90, 0), (110, 110)])
def test_a_recorders_clock_that_is_behind_the_stamps_is_put_right(tmp_path, lead_ms, shift_ms):
    bus, heard, ms = OfflineBus(), [], 10**6
    node = bus.add(ManagedNode)
    node.add_subscription("odom", Odometry, lambda message: heard.append(bus.now_ns))
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("odom", Odometry(header=header((1000 + lead_ms) * ms, "odom")), 1000 * ms)
    with BagReader(tmp_path / "bag") as bag:
        list(replay(bag, bus))
    assert heard == [(1000 + shift_ms) * ms]


def test_topics_are_renamed_and_a_required_one_that_is_not_in_the_bag_is_told(make_bag):
    path = make_bag()
    bus = OfflineBus()
    echo = bus.add(Echo, remap={"text": "/latched", "echo": "said"})
    with BagReader(path) as bag:
        assert [(item.topic, item.message.data) for item in replay(bag, bus)] == [("/said", "once")]
    assert len(echo.heard) == 1
    bus = OfflineBus()
    bus.add(Echo, remap={"text": "image_raw"})
    with BagReader(path) as bag, pytest.raises(BagError, match="expected topic /image_raw, found /latched"):
        list(replay(bag, bus))


def test_outputs_go_into_a_bag_with_their_qos_and_the_progress_is_told(make_bag, tmp_path):
    path = make_bag()
    bus = OfflineBus(captured={"echo"})
    bus.add(Echo)
    with BagReader(path) as bag, BagWriter(tmp_path / "out") as out:
        assert sum(1 for _ in record(replay(bag, bus), out, bus)) == 39
    with BagReader(tmp_path / "out") as bag:
        assert bag.topics["/echo"].count == 39
        assert bag.topics["/echo"].profile.durability == qos.TRANSIENT_LOCAL
    bus, steps = OfflineBus(), []
    bus.add(Echo)
    with BagReader(path) as bag:
        published = list(replay(bag, bus, progress=steps.append))
    assert [item.message.data for item in published][-2:] == ["38", "39"]
    assert (len(steps), len(published)) == (40, 39)  # one was refused
