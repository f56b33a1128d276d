"""Stamps of the future are not believed, a little lead of the clock is."""

import pytest

from sphere_nav.ros.clocks import MAX_AHEAD_NS, ahead_s, check_stamp

NOW = 10**12


@pytest.mark.parametrize(
    ("lead", "expected"), [(-(10**12) + 1, 0.0), (0, 0.0), (MAX_AHEAD_NS, 0.0), (3600 * 10**9, 3600.0)]
)
def test_only_what_is_far_ahead_of_the_clock_counts(lead, expected):
    assert ahead_s(NOW + lead, NOW) == expected


def test_without_a_clock_nothing_is_ahead():
    assert ahead_s(NOW, 0) == 0.0


def test_the_refusal_names_who_and_how_far():
    check_stamp(NOW, NOW, "odom")
    with pytest.raises(ValueError, match=r"odom: stamp: expected at most 0\.1 s ahead, found 2\.000 s"):
        check_stamp(NOW + 2 * 10**9, NOW, "odom")
