"""Who confirms a command: the follower, by what it says after the command, not before."""

import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from sphere_nav.cli.operate.link import Link
from sphere_nav.cli.operate.words import Heard

STOPPED = SimpleNamespace(state="STOPPED", reason="OPERATOR")


@pytest.mark.parametrize(
    ("state", "after_s", "told"),
    [("STOPPED", 0.1, "STOPPED OPERATOR"), ("STOPPED", None, "NOT CONFIRMED"), ("DRIVING", 0.1, "NOT CONFIRMED")],
)
def test_what_the_follower_said_before_a_command_does_not_confirm_it(monkeypatch, state, after_s, told):
    monkeypatch.setattr("sphere_nav.cli.operate.link.CONFIRMED_S", 5.0 if told.endswith("OPERATOR") else 0.3)
    link = Link.__new__(Link)
    link.seen = Heard()
    link.seen.hear("follower", STOPPED)
    time.sleep(0.01)
    if after_s is not None:
        threading.Timer(after_s, link.seen.hear, ("follower", STOPPED)).start()
    begin = time.monotonic()
    assert link._confirmed(lambda status: status.state == state).startswith(told)
    assert time.monotonic() - begin >= 0.1
