import numpy as np
import pytest

from cycab_sim.world.paths import rounded
from cycab_sim.world.town import draw_plan, taught_path
from cycab_sim.world.traffic.loops import WIDTHS, Loop, free_loops, town_loops

# Written out: imported, a change would go unseen.
CLEAR, SPACING = 1.0, 0.25

PLAN = draw_plan(5)


def test_a_polygon_with_round_corners_is_a_closed_path():
    path = rounded(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]]), 2.0)
    assert path.length == pytest.approx(60.0 - 16.0 + 4.0 * np.pi)
    start, end = path.at(np.array([0.0, path.length - 1e-9]))
    np.testing.assert_allclose(start[:2], end[:2], atol=1e-6)
    points = path.at(np.linspace(0, path.length, 500))[:, :2]
    assert np.all((points > -1e-9) & (points < [20.0 + 1e-9, 10.0 + 1e-9]))
    with pytest.raises(ValueError, match="radius: expected arcs that fit"):
        rounded(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 3.0]]), 2.0)


def test_a_loop_closes_and_goes_on():
    angle = np.arange(80) * np.pi / 40
    loop = Loop("walk", np.stack([np.cos(angle), np.sin(angle)], axis=1) * 20 * SPACING)
    points = loop.at(np.array([0.0, loop.length, 3 * loop.length, -loop.length / 2]))
    np.testing.assert_allclose(points[:3], [[5.0, 0.0]] * 3)
    np.testing.assert_allclose(points[3], [-5.0, 0.0], atol=1e-9)


def test_free_loops_leave_room_for_the_car_on_its_path():
    path = taught_path(PLAN, "two_turns")
    loops = free_loops(town_loops(PLAN), path, may_cross=False)
    assert {loop.kind for loop in loops} == {"road", "cycle", "walk"}
    points = path.at(np.arange(0.0, path.length, 0.1))[:, :2]
    for loop in loops:
        distance = np.linalg.norm(loop.points[:, None] - points[None], axis=2).min()
        assert distance > CLEAR + WIDTHS[loop.kind] / 2 - 0.02  # sampled more coarsely there
    assert len(free_loops(town_loops(PLAN), path, may_cross=True)) > len(loops)
