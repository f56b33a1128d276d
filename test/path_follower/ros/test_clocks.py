"""Stamps on the follower's own clock."""

import pytest

from path_follower.ros.clocks import Times

SECOND = 1_000_000_000


def times(clock, own):
    return Times(lambda: clock, lambda: own)


def test_a_message_counts_from_its_stamp_but_never_from_later_than_now():
    assert times(100 * SECOND, 7 * SECOND).of(99 * SECOND) == 6 * SECOND
    assert times(100 * SECOND, 7 * SECOND).of(100 * SECOND + SECOND // 20) == 7 * SECOND


def test_a_stamp_ahead_of_the_clock_is_refused():
    with pytest.raises(ValueError, match=r"expected at most 0\.1 s ahead of the clock, found 3600\.000 s"):
        times(100 * SECOND, 7 * SECOND).of(3700 * SECOND)
