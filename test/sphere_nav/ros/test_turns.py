import sys

from sphere_nav.ros.run import take_short_turns

# Written out: imported, a change would go unseen.
TURN_S = 0.0005


def test_threads_take_shorter_turns_than_python_gives_them():
    before = sys.getswitchinterval()
    try:
        take_short_turns()
        assert abs(sys.getswitchinterval() - TURN_S) < 1e-6 < before
    finally:
        sys.setswitchinterval(before)
