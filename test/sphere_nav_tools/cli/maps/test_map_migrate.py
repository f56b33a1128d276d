"""`sphere_nav map-migrate`; what it does with each format: test/sphere_nav/ros/maps/test_migration.py."""

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from sphere_nav.ros.maps.check import verify_map
from sphere_nav_tools.cli.main import main

FORMATS = Path(__file__).parents[2] / "ros" / "maps" / "formats"


def test_an_old_map_is_written_anew_and_one_of_today_is_not(tmp_path, capsys):
    new = str(tmp_path / "new")
    assert main(["map-migrate", str(FORMATS / "format_1"), "-o", new]) == 0
    assert "3 key spheres, from format 1" in capsys.readouterr().out
    assert verify_map(new) == []
    assert main(["map-migrate", new, "-o", str(tmp_path / "newer")]) == 1
    assert "already" in capsys.readouterr().out
    assert not (tmp_path / "newer").exists()


def test_nothing_is_overwritten(tmp_path, capsys):
    (tmp_path / "new").mkdir()
    assert main(["map-migrate", str(FORMATS / "format_1"), "-o", str(tmp_path / "new")]) == 2
    assert "nothing is overwritten" in capsys.readouterr().err
