"""Time in nanoseconds."""

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped

from sphere_nav.ros.conversions import header, ns_to_time, stamp_ns, time_to_ns


def test_a_time_comes_back_to_the_nanosecond():
    for ns in [0, 1, 999_999_999, 1_000_000_000, 1_778_234_353_382_747_001, (2**31) * 10**9 - 1]:
        assert time_to_ns(ns_to_time(ns)) == ns
        assert stamp_ns(PoseStamped(header=header(ns, "map"))) == ns


def test_what_a_message_cannot_hold_is_refused():
    for ns in [-1, 2**31 * 10**9]:
        with pytest.raises(ValueError, match="stamp: expected 0 to"):
            ns_to_time(ns)


def test_what_could_not_be_sent_on_is_not_taken():
    for time in [Time(sec=-1, nanosec=342_388_850), Time(sec=2**31 - 1, nanosec=10**9)]:
        with pytest.raises(ValueError, match="stamp: expected 0 to 2"):
            time_to_ns(time)
