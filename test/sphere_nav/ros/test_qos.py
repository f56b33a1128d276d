"""QoS in words, as YAML, and what fits to what."""

from sphere_nav.ros import qos

PROFILES = [qos.SENSOR, qos.STATE, qos.LATCHED, qos.LARGE, qos.COMMAND, qos.TF_STATIC]


def parts(profile):
    return profile.reliability, profile.durability, profile.depth


def test_what_was_latched_is_known_by_its_yaml_also_of_older_bags_and_odd_texts_are_harmless():
    for profile in PROFILES:
        latched = qos.LATCHED if profile.durability == qos.TRANSIENT_LOCAL else qos.STATE
        assert qos.from_yaml(qos.to_yaml(profile)) == latched
    for number, latched in [(1, qos.LATCHED), (2, qos.STATE), (10, qos.STATE)]:
        assert qos.from_yaml(f"- history: 1\n  depth: 7\n  reliability: 2\n  durability: {number}\n") == latched
    presets = (qos.RELIABLE, qos.VOLATILE, 10), (qos.BEST_EFFORT, qos.VOLATILE, 5)
    for text in ["", "   ", "[]", "- 3", "- depth: -1"]:
        assert (parts(qos.from_yaml(text)), parts(qos.SENSOR)) == presets


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
