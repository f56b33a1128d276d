"""A drive by direction: how it is judged; none is driven here."""

import numpy as np
import pytest

from sphere_nav_tools.cli.experiment.homing import HomingDrive, homing_figures

TAUGHT = np.column_stack([np.arange(0.0, 50.1, 0.5), np.zeros(101), np.zeros(101)])


def by_name(driven, poses, directions):
    return {figure.name: figure for figure in homing_figures(TAUGHT, driven, poses, directions, 1.0, 1.5)}


@pytest.mark.parametrize(
    ("aside", "end", "is_near", "has_ended"), [(1.4, 49.2, True, True), (-1.6, 48.8, False, False)]
)
def test_the_path_and_its_end_are_kept_or_not(aside, end, is_near, has_ended):
    x = np.append(np.arange(0.0, end, 0.4), end)
    y = np.where((x > 20.0) & (x < 25.0), aside, 0.2)
    found = by_name(np.column_stack([x, y, np.zeros_like(x)]), TAUGHT[[40]], np.zeros(1))
    assert found["distance from the path, largest"].value == pytest.approx(abs(aside))
    assert found["distance from the path, largest"].is_met is is_near
    assert found["end of the drive from the end of the path"].is_met is has_ended
    assert found["distance from the path, median"].value == pytest.approx(0.2)
    assert found["share of the path that was driven"].value == pytest.approx(end / 50.0, abs=0.01)


def test_a_direction_is_that_from_the_heading_to_the_path_ahead():
    poses = np.array([[10.0, 4.0, 0.3], [20.0, -4.0, -0.2], [30.0, 0.0, 0.0]])
    true = np.array([-np.pi / 4 - 0.3, np.pi / 4 + 0.2, 0.0])
    found = by_name(TAUGHT, poses, true)
    assert found["directions off, median"].value == pytest.approx(0.0, abs=0.3)
    found = by_name(TAUGHT, poses, true + np.radians([10.0, -50.0, 20.0]))
    assert found["directions within 45 deg of the path 4 m ahead"].value == pytest.approx(200.0 / 3.0)
    assert found["directions off, median"].value == pytest.approx(20.0, abs=0.3)


def test_the_follower_has_no_pose():
    assert HomingDrive.follower["source"] == "homing"
    assert "/homing/direction" in HomingDrive.recorded.split()
