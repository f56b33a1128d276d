"""QoS in words, as YAML, and what fits to what."""

import pytest
from rclpy.qos import QoSProfile

from sphere_nav.ros import qos

BEST_EFFORT = qos.SENSOR
PROFILES = [qos.SENSOR, qos.STATE, qos.LATCHED, qos.LARGE, qos.COMMAND, qos.TF_STATIC]


def parts(profile):
    return profile.reliability, profile.durability, profile.depth


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_comes_back_from_yaml(profile):
    assert [parts(found) for found in qos.from_yaml(qos.profiles_to_yaml([profile, qos.STATE]))] == [
        parts(profile),
        parts(qos.STATE),
    ]


def test_older_bags_have_numbers():
    text = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 1\n"
    assert [parts(found) for found in qos.from_yaml(text)] == [(qos.BEST_EFFORT, qos.TRANSIENT_LOCAL, 7)]


@pytest.mark.parametrize("text", ["", "   ", "[]", "- 3", "- depth: -1"])
def test_odd_texts_are_harmless(text):
    assert len(qos.from_yaml(text)) <= 1


@pytest.mark.parametrize(
    ("offered", "asked", "reason"),
    [
        (qos.STATE, qos.SENSOR, ""),
        (qos.LATCHED, qos.STATE, ""),
        (qos.SENSOR, qos.STATE, "it offers best effort, asked is reliable"),
        (qos.STATE, qos.LATCHED, "it offers volatile, asked is transient local"),
    ],
)
def test_a_mismatch_is_told(offered, asked, reason):
    assert qos.mismatch(offered, asked) == reason


@pytest.mark.parametrize("offers", [[], [qos.SENSOR], [qos.LATCHED], [qos.LATCHED, qos.STATE], [qos.STATE, qos.SENSOR]])
def test_an_adapted_profile_fits_every_offer(offers):
    profile = qos.adapted(offers)
    assert [qos.mismatch(offer, profile) for offer in offers] == [""] * len(offers)


def test_an_adapted_profile_is_as_strict_as_it_can_be():
    assert parts(qos.adapted([qos.LATCHED], depth=9)) == (qos.RELIABLE, qos.TRANSIENT_LOCAL, 9)
    assert qos.adapted([qos.LATCHED, qos.STATE]).durability == qos.VOLATILE


def test_words():
    assert qos.describe_policies(qos.LATCHED) == "reliable, transient local, depth 1"
    assert qos.describe_policies(QoSProfile(depth=3, reliability=qos.BEST_EFFORT)) == "best effort, volatile, depth 3"
