import numpy as np
import pytest

from cycab_sim.world import city
from cycab_sim.world.finishes import METAL
from cycab_sim.world.mesh import MeshBuilder
from cycab_sim.world.paths import Path, Piece, rounded
from cycab_sim.world.town import draw_plan, taught_path
from cycab_sim.world.traffic import loops
from cycab_sim.world.traffic.loops import WIDTHS, Loop, free_loops, town_loops, walk_around

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


@pytest.mark.parametrize("name", ["two_turns", "block"])
def test_free_loops_leave_room_for_the_car_on_its_path(name):
    path = taught_path(PLAN, name)
    loops = free_loops(town_loops(PLAN), path, may_cross=False)
    assert {loop.kind for loop in loops} == {"road", "cycle", "walk"}
    points = path.at(np.arange(0.0, path.length, 0.1))[:, :2]
    for loop in loops:
        distance = np.linalg.norm(loop.points[:, None] - points[None], axis=2).min()
        assert distance > CLEAR + WIDTHS[loop.kind] / 2 - 0.02  # sampled more coarsely there
    assert len(free_loops(town_loops(PLAN), path, may_cross=True)) > len(loops)


def test_a_walk_leads_around_a_lamp():
    mesh = MeshBuilder(np.random.default_rng(1))
    mesh.box([9.9, -0.1, 0.0], [0.2, 0.2, 4.0], METAL)
    mesh.box([4.0, -0.5, 2.2], [1.0, 1.0, 0.2], METAL)  # high enough to walk below
    x = np.arange(0.0, 20.0, SPACING)
    back = np.stack([x[::-1], np.full(len(x), 5.0)], axis=1)
    straight = Loop("walk", np.concatenate([np.stack([x, 0.0 * x], axis=1), back]))
    led = walk_around([straight], mesh.build())[0]
    assert np.linalg.norm(led.points - [10.0, 0.0], axis=1).min() > 0.45
    np.testing.assert_allclose(led.points[15:25], straight.points[15:25], atol=0.15)  # x = 4 to 6 m


def test_a_street_without_a_path_in_it_is_free():
    far, loops = Path((1000.0, 0.0, 0.0), (Piece(10.0),)), town_loops(PLAN)
    free = free_loops(loops, far, may_cross=False)
    assert [loop for loop in loops if not loop.is_crossing] == free
    assert len(free) < len(loops)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ways", "number"),
    [
        (lambda: town_loops(draw_plan(5)), -1.97989),
        (loops.city_loops, 2.07813),
        (loops.road_loops, -1.37205),
        (loops.square_loops, 1.23127),
    ],
)
def test_the_loops_of_a_world_are_where_they_are(ways, number, fingerprint):
    rows = [np.column_stack([loop.points, np.full(len(loop.points), loop.z)]) for loop in ways()]
    assert fingerprint(np.concatenate(rows)) == pytest.approx([number], abs=2e-5)


def test_boxes_are_marked_and_cut_at_the_edge():
    grid = np.ones((5, 6), np.uint8)
    loops._clear(np.array([[1, 1, 2, 2], [4, 3, 9, 9]]), grid)
    assert grid.sum() == 30 - 4 - 4
    assert grid[2, 1] == grid[4, 5] == 0


def signed_area(loop):
    """Return the area in m^2, negative where a loop goes clockwise."""
    ahead = np.roll(loop.points, -1, axis=0)
    return 0.5 * float(np.sum(loop.points[:, 0] * ahead[:, 1] - ahead[:, 0] * loop.points[:, 1]))


def test_the_citys_cars_and_cyclists_keep_to_the_right_of_its_streets():
    """Around the block of streets A, B, C and F: inside it clockwise, outside of it the other way."""
    inner, around, outer, tram, cycles, square = loops.city_loops()[:6]
    assert [loop.kind for loop in loops.city_loops()[:6]] == ["road"] * 4 + ["cycle"] * 2
    assert [loop.has_rails for loop in loops.city_loops()] == [False] * 3 + [True] + [False] * 17
    west, south, east, north = -20.0, 0.0, 40.0, 110.0  # the middles of the streets
    for loop, off, turn in ((inner, 1.6, -1), (outer, -1.6, 1), (cycles, 3.2, -1)):
        np.testing.assert_allclose(loop.points.min(axis=0), [west + off, south + off], atol=1e-9)
        np.testing.assert_allclose(loop.points.max(axis=0), [east - off, north - off], atol=1e-9)
        assert np.sign(signed_area(loop)) == turn
    x0, y0, x1, y1 = city.BOUNDS
    assert np.all(np.any((around.points < [x0, y0]) | (around.points > [x1, y1]), axis=1))
    np.testing.assert_allclose(tram.points.max(axis=0), np.max(city.TRAM, axis=0), atol=1e-9)
    assert np.all((square.points > city.SQUARE[:2]) & (square.points < city.SQUARE[2:]))


def test_the_citys_walks_go_round_blocks_on_the_pavement_by_turns_and_none_leads_along_the_lane():
    walks = [loop for loop in loops.city_loops() if loop.kind == "walk"]
    raised, level = [walk for walk in walks if walk.z > 0.0], [walk for walk in walks if walk.z == 0.0]
    found = {tuple(np.round([*walk.points.min(axis=0), *walk.points.max(axis=0)], 6).tolist()) for walk in raised}
    assert found == {(x0 + 1, y0 + 1, x1 - 1, y1 - 1) for (x0, y0, x1, y1), sides in city.BLOCKS if "l" not in sides}
    assert len(raised) == 11
    assert len(level) == 4  # on the square, and across the end of street A
    turns = np.sign([signed_area(walk) for walk in walks])
    np.testing.assert_array_equal(turns, np.where(np.arange(15) % 2, 1, -1))
    assert not any(np.any(np.all(np.abs(walk.points - [city.LANE_X, 80.0]) < [1.5, 24.0], axis=1)) for walk in walks)
