"""What `missions` says while it drives."""

import pytest

pytest.importorskip("rclpy")

from benchmarks.drive.mission_town import Driven
from benchmarks.drive.missions import drive_all


class Stopped:
    """A town whose benchmark is stopped in its third mission."""

    def __init__(self):
        self.asked = []

    def drive(self, closing):
        self.asked.append(closing)
        if len(self.asked) == 3:
            raise KeyboardInterrupt
        return Driven("church", "mill", closing, is_arrived=not closing, reason="lost", distance=210.4)


def test_what_was_driven_before_it_is_stopped_is_said(capsys):
    town = Stopped()
    with pytest.raises(KeyboardInterrupt):
        list(drive_all(town, ["", "call", "obstacle"]))
    assert town.asked == ["", "call", "obstacle"]
    heading, *lines = [line.split(" | ") for line in capsys.readouterr().err.splitlines()]
    assert heading[:5] == ["from", "to", "closed", "arrived", "m"]
    assert [line[:5] for line in lines] == [
        ["church", "mill", "–", "yes", "210"],
        ["church", "mill", "call", "lost", "210"],
    ]
