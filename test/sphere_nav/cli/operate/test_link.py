"""Who confirms a command: the follower, by what it says after the command, not before."""

from itertools import chain, repeat
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from sphere_nav.cli.operate.link import Link

STOPPED = SimpleNamespace(state="STOPPED", reason="OPERATOR")
OLD, NEW = 1000.0, 0.0  # s since it was heard


@pytest.mark.parametrize(
    ("state", "ages", "told"),
    [
        ("STOPPED", chain([OLD] * 3, repeat(NEW)), "STOPPED OPERATOR"),
        ("STOPPED", repeat(OLD), "NOT CONFIRMED"),
        ("DRIVING", repeat(NEW), "NOT CONFIRMED"),
    ],
    ids=["after", "before", "another"],
)
def test_what_the_follower_said_before_a_command_does_not_confirm_it(monkeypatch, state, ages, told):
    monkeypatch.setattr("sphere_nav.cli.operate.link.CONFIRMED_S", 60.0 if told == "STOPPED OPERATOR" else 0.2)
    link, heard = Link.__new__(Link), []

    def tell(name):
        heard.append(next(ages))
        return STOPPED, heard[-1]

    link.seen = SimpleNamespace(told=tell)
    assert link._confirmed(lambda status: status.state == state).startswith(told)
    assert told == "NOT CONFIRMED" or heard == [OLD] * 3 + [NEW]
