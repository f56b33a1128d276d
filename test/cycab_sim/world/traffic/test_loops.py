import numpy as np

from cycab_sim.world.town import draw_plan, taught_path
from cycab_sim.world.traffic.loops import WIDTHS, free_loops, town_loops

CLEAR = 1.0

PLAN = draw_plan(5)


def test_free_loops_leave_room_for_the_car_on_its_path():
    path = taught_path(PLAN, "two_turns")
    loops = free_loops(town_loops(PLAN), path, may_cross=False)
    assert {loop.kind for loop in loops} == {"road", "cycle", "walk"}
    points = path.at(np.arange(0.0, path.length, 0.1))[:, :2]
    for loop in loops:
        distance = np.linalg.norm(loop.points[:, None] - points[None], axis=2).min()
        assert distance > CLEAR + WIDTHS[loop.kind] / 2 - 0.02  # sampled more coarsely there
    assert len(free_loops(town_loops(PLAN), path, may_cross=True)) > len(loops)
