import pytest

from sphere_mapping.acquisition.pairing import MAX_WAITING, Pairing


def test_an_instant_is_complete_when_every_stream_has_it():
    pairing = Pairing(("a", "b"), 5)
    assert pairing.put("b", 102, "b0") is None
    assert pairing.put("a", 100, "a0") == (100, {"a": "a0", "b": "b0"})


def test_each_item_is_used_once_and_the_nearest_wins():
    pairing = Pairing(("a", "b"), 5)
    pairing.put("b", 96, "far")
    pairing.put("b", 101, "near")
    assert pairing.put("a", 100, "a") == (100, {"a": "a", "b": "near"})
    assert pairing.put("a", 104, "again") is None


def test_beyond_the_slack_nothing_pairs():
    pairing = Pairing(("a", "b"), 5)
    pairing.put("a", 100, "a")
    assert pairing.put("b", 106, "b") is None


def test_a_stamp_of_the_past_is_refused():
    pairing = Pairing(("a", "b"), 0)
    pairing.put("a", 100, "a")
    pairing.put("b", 100, "b")
    with pytest.raises(ValueError, match="a: expected a stamp after 100, found 90"):
        pairing.put("a", 90, "late")
    pairing.clear()
    assert pairing.put("a", 90, "new") is None


def test_a_missing_stream_does_not_fill_the_memory():
    pairing = Pairing(("a", "b"), 1)
    for stamp in range(0, 1000, 10):
        pairing.put("a", stamp, "x")
    assert pairing.num_unpaired == 100 - MAX_WAITING
    assert pairing.put("b", 990, "y") == (990, {"a": "x", "b": "y"})
