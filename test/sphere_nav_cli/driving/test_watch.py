"""The watch over a drive."""

import pytest

from sphere_nav_cli.driving import watch as module
from sphere_nav_cli.driving.processes import Processes
from sphere_nav_cli.driving.watch import DriveFailed, Watch

DOMAIN = 48


@pytest.mark.parametrize(("travelled", "patience"), [(0.0, "START_UP"), (3.0, "STALL")])
def test_a_drive_in_which_nothing_happens_fails_and_says_who_is_silent(tmp_path, monkeypatch, travelled, patience):
    monkeypatch.setattr(module, patience, 0.5)
    silent = "drive: nothing for 0 s; localiser silent, follower silent"
    with Processes(tmp_path, DOMAIN) as processes, Watch(processes, DOMAIN) as watch:
        watch.travelled = travelled
        with pytest.raises(DriveFailed, match=silent):
            watch.wait("drive", lambda: False, is_moving=True)


def test_waiting_ends_when_it_holds(tmp_path):
    with Processes(tmp_path, DOMAIN) as processes, Watch(processes, DOMAIN) as watch:
        answers = iter([False, False, True])
        watch.wait("three looks", lambda: next(answers), is_moving=False)
        watch.pause(0.2)
