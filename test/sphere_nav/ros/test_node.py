"""What every node inherits."""

from itertools import count

import pytest
from std_msgs.msg import String
from std_srvs.srv import SetBool

from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.node import ManagedNode


class Plain(ManagedNode):
    NAME = "plain"


def test_what_is_forgotten_is_not_heard_and_an_output_knows_its_listeners():
    bus, heard = OfflineBus(captured=set()), []
    node = bus.add(Plain)
    wanted = node.add_subscription("text", String, heard.append)
    bus.deliver("/text", String(data="a"))
    node.remove_subscription(wanted)
    bus.deliver("/text", String(data="b"))
    assert [message.data for message in heard] == ["a"]
    assert node.inputs == []
    output = node.add_publisher("text", String)
    assert output.num_subscriptions == 0
    node.add_subscription("text", String, lambda message: None)
    assert output.num_subscriptions == 1
    with pytest.raises(ValueError, match="unknown parameter"):
        bus.add(Plain, {"speed": 1.0})


def test_requests_that_fail_alike_are_answered_each_and_told_once_in_five_seconds(caplog):
    def on_call(request, response):
        raise KeyError("x") if request.data else ValueError(f"request: expected 1, found {next(numbers)}")

    bus, answers, numbers = OfflineBus(), [], count()
    node = bus.add(Plain)
    node.add_service("~/call", SetBool, on_call)
    for second in (1, 6):
        list(bus.advance(second * 10**9))
        answers += [node.endpoints.call("call", SetBool.Request(data=number == 9)).message for number in range(10)]
    assert len(set(answers)) == 19  # KeyError says the same twice
    assert [record.message.splitlines()[0] for record in caplog.records] == [
        "~/call: request: expected 1, found 0",
        "~/call: Traceback (most recent call last):",
        "~/call: request: expected 1, found 9",
        "~/call: Traceback (most recent call last):",
    ]
