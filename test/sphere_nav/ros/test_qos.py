"""QoS in words, as YAML, and what fits to what."""

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int32, String

from sphere_nav.ros import qos
from sphere_nav.ros.rclpy_shell import unserved
from worlds.desk import PATIENCE
from worlds.patience import wait_until

PROFILES = [qos.SENSOR, qos.STATE, qos.LATCHED, qos.LARGE, qos.COMMAND, qos.TF_STATIC]


def parts(profile):
    return profile.reliability, profile.durability, profile.depth


def test_what_was_latched_is_known_by_its_yaml_also_of_older_bags_and_odd_texts_are_harmless():
    for profile in PROFILES:
        latched = qos.LATCHED if profile.durability == qos.TRANSIENT_LOCAL else qos.STATE
        assert qos.from_yaml(qos.to_yaml(profile)) == latched
    for number, latched in [(1, qos.LATCHED), (2, qos.STATE), (10, qos.STATE)]:
        assert qos.from_yaml(f"- history: 1\n  depth: 7\n  reliability: 2\n  durability: {number}\n") == latched
    for text in ["", "   ", "[]", "- 3", "- depth: -1"]:
        assert qos.from_yaml(text) == qos.STATE


def test_a_mismatch_is_told():
    for offered, asked, reason in [
        (qos.STATE, qos.SENSOR, ""),
        (qos.LATCHED, qos.STATE, ""),
        (qos.SENSOR, qos.STATE, "it offers best effort, asked is reliable"),
        (qos.STATE, qos.LATCHED, "it offers volatile, asked is transient local"),
    ]:
        assert qos.mismatch(offered, asked) == reason


def test_an_adapted_profile_fits_every_offer_and_is_as_strict_as_it_can_be():
    for offers in [[], [qos.SENSOR], [qos.LATCHED], [qos.LATCHED, qos.STATE], [qos.STATE, qos.SENSOR]]:
        profile = qos.adapted(offers, 100)
        assert [qos.mismatch(offer, profile) for offer in offers] == [""] * len(offers)
    assert parts(qos.adapted([qos.LATCHED], depth=9)) == (qos.RELIABLE, qos.TRANSIENT_LOCAL, 9)
    assert qos.adapted([qos.LATCHED, qos.STATE], 100).durability == qos.VOLATILE


@pytest.fixture
def pair(ros):
    context = rclpy.Context()  # a participant of its own: within one, DDS refuses a second type at once
    rclpy.init(context=context)
    nodes = Node("speaker"), Node("hearer", context=context)
    yield nodes
    for node in nodes:
        node.destroy_node()
    context.shutdown()


def told(speaker, publishers, line):
    """Whether it is told in time: DDS tells the name of a node a little later."""
    return wait_until(lambda: list(unserved(speaker, publishers)) == [line], PATIENCE)


def test_subscriptions_that_ask_for_more_or_for_another_type_are_named(pair):
    speaker, hearer = pair
    publisher = speaker.create_publisher(Int32, "told", qos.STATE)
    hearer.create_subscription(Int32, "told", lambda message: None, qos.STATE)
    assert wait_until(lambda: publisher.get_subscription_count() == 1, PATIENCE)
    assert list(unserved(speaker, [publisher])) == []
    hearer.create_subscription(Int32, "told", lambda message: None, qos.LATCHED)
    line = "/told: /hearer gets nothing: it offers volatile, asked is transient local"
    assert told(speaker, [publisher], line)
    publisher = speaker.create_publisher(Int32, "number", qos.STATE)
    hearer.create_subscription(String, "number", lambda message: None, qos.STATE)
    line = "/number: /hearer gets nothing: it asks for std_msgs/msg/String, sent is std_msgs/msg/Int32"
    assert told(speaker, [publisher], line)
