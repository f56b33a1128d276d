"""QoS in words, as YAML, and what fits to what."""

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import Int32, String

from sphere_nav.ros import qos
from sphere_nav.ros.rclpy_shell import unserved
from worlds.desk import PATIENCE
from worlds.patience import wait_until

BEST_EFFORT = qos.SENSOR
PROFILES = [qos.SENSOR, qos.STATE, qos.LATCHED, qos.LARGE, qos.COMMAND, qos.TF_STATIC]


def parts(profile):
    return profile.reliability, profile.durability, profile.depth


def test_a_profile_comes_back_from_yaml():
    for profile in PROFILES:
        assert [parts(found) for found in qos.from_yaml(qos.profiles_to_yaml([profile, qos.STATE]))] == [
            parts(profile),
            parts(qos.STATE),
        ]


def test_older_bags_have_numbers():
    text = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 1\n"
    assert [parts(found) for found in qos.from_yaml(text)] == [(qos.BEST_EFFORT, qos.TRANSIENT_LOCAL, 7)]


def test_odd_texts_are_harmless():
    for text in ["", "   ", "[]", "- 3", "- depth: -1"]:
        assert len(qos.from_yaml(text)) <= 1


def test_a_mismatch_is_told():
    for offered, asked, reason in [
        (qos.STATE, qos.SENSOR, ""),
        (qos.LATCHED, qos.STATE, ""),
        (qos.SENSOR, qos.STATE, "it offers best effort, asked is reliable"),
        (qos.STATE, qos.LATCHED, "it offers volatile, asked is transient local"),
    ]:
        assert qos.mismatch(offered, asked) == reason


def test_an_adapted_profile_fits_every_offer():
    for offers in [[], [qos.SENSOR], [qos.LATCHED], [qos.LATCHED, qos.STATE], [qos.STATE, qos.SENSOR]]:
        profile = qos.adapted(offers)
        assert [qos.mismatch(offer, profile) for offer in offers] == [""] * len(offers)


def test_an_adapted_profile_is_as_strict_as_it_can_be():
    assert parts(qos.adapted([qos.LATCHED], depth=9)) == (qos.RELIABLE, qos.TRANSIENT_LOCAL, 9)
    assert qos.adapted([qos.LATCHED, qos.STATE]).durability == qos.VOLATILE


@pytest.fixture
def pair(ros):
    context = rclpy.Context()  # a participant of its own: within one, DDS refuses a second type at once
    rclpy.init(context=context)
    nodes = Node("speaker"), Node("hearer", context=context)
    yield nodes
    for node in nodes:
        node.destroy_node()
    context.shutdown()


def wait(is_done):
    assert wait_until(is_done, PATIENCE), "nothing came in time"


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
