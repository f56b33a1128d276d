"""What DDS does not connect is named: over real DDS, since it decides."""

import time

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int32, String

from sphere_nav.ros import qos
from sphere_nav.ros.rclpy_shell import unserved
from worlds.patience import Patience

PATIENCE = 15.0  # s


@pytest.fixture
def pair(ros):
    context = rclpy.Context()  # a participant of its own: within one, DDS refuses a second type at once
    rclpy.init(context=context)
    nodes = Node("speaker"), Node("hearer", context=context)
    yield nodes
    for node in nodes:
        node.destroy_node()
    context.shutdown()


def wait(condition):
    patience = Patience(PATIENCE)
    while not condition():
        assert patience.is_left(), "nothing came in time"
        time.sleep(0.02)


def test_subscriptions_that_ask_for_more_are_named(pair):
    speaker, hearer = pair
    publisher = speaker.create_publisher(Int32, "told", qos.STATE)
    hearer.create_subscription(Int32, "told", lambda message: None, qos.STATE)
    wait(lambda: publisher.get_subscription_count() == 1)
    assert list(unserved(speaker, [publisher])) == []
    hearer.create_subscription(Int32, "told", lambda message: None, qos.LATCHED)
    line = "/told: /hearer gets nothing: it offers volatile, asked is transient local"
    wait(lambda: list(unserved(speaker, [publisher])) == [line])  # DDS tells the name of the node a little later


def test_subscriptions_of_another_type_are_named(pair):
    speaker, hearer = pair
    publisher = speaker.create_publisher(Int32, "told", qos.STATE)
    hearer.create_subscription(String, "told", lambda message: None, qos.STATE)
    line = "/told: /hearer gets nothing: it asks for std_msgs/msg/String, sent is std_msgs/msg/Int32"
    wait(lambda: list(unserved(speaker, [publisher])) == [line])  # DDS tells the name of the node a little later
