"""What `missions` says while it drives."""

import pytest

pytest.importorskip("rclpy")

from benchmarks.drive.mission_town import Driven
from benchmarks.drive.missions import drive_all


class Stopped:
    """A town whose benchmark is stopped in its third mission."""

    num_asked = 0

    def drive(self):
        self.num_asked += 1
        if self.num_asked == 3:
            raise KeyboardInterrupt
        return Driven("church", "mill", is_arrived=self.num_asked == 1, reason="lost", distance=210.4)


def test_what_was_driven_before_it_is_stopped_is_said(capsys):
    town = Stopped()
    with pytest.raises(KeyboardInterrupt):
        list(drive_all(town, 5))
    heading, *lines = [line.split(" | ") for line in capsys.readouterr().err.splitlines()]
    assert heading[:4] == ["from", "to", "arrived", "m"]
    assert [line[:4] for line in lines] == [["church", "mill", "yes", "210"], ["church", "mill", "lost", "210"]]
