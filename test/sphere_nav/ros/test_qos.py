"""QoS in words, as YAML, and what fits to what."""

from sphere_nav.ros import qos

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
