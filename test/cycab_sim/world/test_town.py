import numpy as np
import pytest

from cycab_sim.world import building, furniture, street
from cycab_sim.world.mesh import MeshBuilder, placed
from cycab_sim.world.town import add_skyline, build_town, draw_plan, path_names, taught_path

CLEARANCE = 0.6 + 0.3  # half the width of the car, and what a driver leaves


@pytest.mark.slow
def test_a_seed_is_a_town(town, fingerprint):
    again, plan = build_town.__wrapped__(5)  # the cache left aside
    assert plan == town[1]
    for name in ("triangles", "normals", "surface_of", "frames", "kinds", "params", "colors"):
        np.testing.assert_array_equal(getattr(again, name), getattr(town[0], name))
    assert draw_plan(6) != plan
    numbers = [-0.19449, -1.58757, 0.26226, -0.90022, 0.13586, 0.68526, 1.91884, 0.57839, 0.56807, 0.04959, 0.67089]
    assert fingerprint(again) == pytest.approx(numbers, abs=2e-5)


class Middle(np.random.Generator):
    """Draws the middle of what may be drawn."""

    def uniform(self, low=0.0, high=1.0, size=None):
        return np.full(size, (low + high) / 2) if size else (low + high) / 2

    def normal(self, loc=0.0, scale=1.0, size=None):
        return loc


def test_towers_stand_all_around_beyond_the_edge():
    mesh = MeshBuilder(np.random.default_rng(0))
    add_skyline(mesh, (-20.0, 10.0, 100.0, 90.0), Middle(np.random.PCG64(1)))  # 120 m by 80 m around (40, 50)
    towers = mesh.build().triangles.reshape(28, 36, 3)
    middle = (towers.min(axis=1) + towers.max(axis=1))[:, :2] / 2
    angle = 2 * np.pi * np.arange(28) / 28 + 0.1
    expected = np.stack([40 + (1.3 * 60 + 90) * np.cos(angle), 50 + (1.3 * 40 + 90) * np.sin(angle)], axis=1)
    np.testing.assert_allclose(middle, expected, atol=1e-3)
    np.testing.assert_allclose(towers[..., 2].min(axis=1), 0.0, atol=1e-6)
    np.testing.assert_allclose(towers[..., 2].max(axis=1), 25.0, rtol=1e-6)
    ahead = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    away = np.einsum("tni,ti->tn", towers[..., :2] - middle[:, None], ahead)
    np.testing.assert_allclose(away.max(axis=1), 9.5, atol=1e-3)  # half of 19 m


def test_everything_has_a_surface(town):
    mesh = town[0]
    num = len(mesh.frames)
    assert len(mesh.kinds) == len(mesh.params) == len(mesh.colors) == num
    assert set(np.unique(mesh.surface_of)) <= set(range(num))
    assert np.all(np.isfinite(mesh.triangles))
    assert np.all(np.isfinite(mesh.frames))
    assert len(np.unique(mesh.kinds[:, 0])) >= 14  # materials in use
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_the_taught_path_is_100_m_with_two_turns(seed):
    path = taught_path(draw_plan(seed), "two_turns")
    poses = path.at(np.linspace(0, path.length, 2001))
    assert path.length == pytest.approx(100.0)
    assert poses[-1, 2] - poses[0, 2] == pytest.approx(np.pi)
    assert np.abs(poses[:, 3]).max() == pytest.approx(0.2)  # radius 5 m: a steering angle of 0.24 rad
    assert np.sum(np.diff(poses[:, 3]) > 0.1) == 2


def test_the_block_is_closed_and_other_names_are_refused():
    plan = draw_plan(2)
    path = taught_path(plan, "block")
    start, end = path.at(np.array([0.0, path.length - 1e-9]))
    np.testing.assert_allclose(end[:2], start[:2], atol=1e-6)
    assert path.length > 120.0
    with pytest.raises(ValueError, match="two_turns, block, straight, found 'moon'"):
        taught_path(plan, "moon")


@pytest.mark.parametrize("name", path_names())
def test_nothing_stands_in_the_way(town_renderer, town, name):
    path = taught_path(town[1], name)
    angles = np.radians(np.arange(0, 360, 5))
    rays = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1).astype(np.float32)
    for s in np.arange(0.0, path.length, 1.0):
        x, y, _, _ = path.at(np.array(s))
        for z in (0.3, 0.9, 1.7):
            triangles, ranges = np.empty(72, np.int32), np.empty(72, np.float32)
            town_renderer._cast(np.array([x, y, z]), rays, triangles, ranges)
            assert ranges.min() > CLEARANCE, f"{name} at {s} m, height {z} m"


def test_structure_is_near_and_far(town_renderer, town):
    path = taught_path(town[1], "two_turns")
    angles = np.radians(np.arange(0, 360, 0.5))
    rays = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1).astype(np.float32)
    found = []
    for s in np.arange(0.0, path.length, 5.0):
        x, y, _, _ = path.at(np.array(s))
        triangles, ranges = np.empty(720, np.int32), np.empty(720, np.float32)
        town_renderer._cast(np.array([x, y, 1.6]), rays, triangles, ranges)
        found.append(ranges)
    near, middle, far = np.nanpercentile(np.where(np.isinf(found), 300.0, found), [10, 50, 98])
    assert near < 6.0
    assert middle < 15.0
    assert far > 30.0


@pytest.mark.parametrize(
    ("add", "low", "high"),
    [
        (furniture.add_car, (-2.3, -0.95, -0.02), (2.3, 0.95, 1.75)),
        (furniture.add_lamp, (-0.2, -0.2, 0.0), (1.4, 0.2, 6.1)),
        (furniture.add_traffic_sign, (-0.1, -0.35, 0.0), (0.1, 0.35, 3.0)),
        (furniture.add_bollard, (-0.1, -0.1, 0.0), (0.1, 0.1, 1.0)),
        (furniture.add_box, (-0.6, -0.8, 0.0), (0.6, 0.8, 1.4)),
        (furniture.add_bench, (-0.3, -0.85, 0.0), (0.3, 0.85, 1.0)),
        (furniture.add_tree, (-4.5, -4.5, 0.0), (4.5, 4.5, 9.5)),
    ],
)
def test_furniture_stands_on_its_place(add, low, high):
    for seed in range(6):
        mesh = MeshBuilder(np.random.default_rng(seed))
        add(mesh, placed(10.0, 20.0, 0.0), np.random.default_rng(seed))
        points = mesh.build().triangles.reshape(-1, 3) - [10.0, 20.0, 0.0]
        assert np.all(points.min(axis=0) >= np.array(low) - 1e-4)
        assert np.all(points.max(axis=0) <= np.array(high) + 1e-4)


def test_a_house_has_windows_in_relief():
    mesh = MeshBuilder(np.random.default_rng(4))
    building.add_house(mesh, placed(0.0, 0.0, 0.0), 9.0, 8.0, 3, np.random.default_rng(4))
    built = mesh.build()
    front = built.triangles[np.abs(built.normals[:, 1] + 1.0) < 1e-3].mean(axis=1)
    depths = np.unique(np.round(front[(front[:, 2] < 9.0) & (front[:, 1] < 1.0), 1], 2))
    assert depths.min() < -0.05  # ledges
    assert np.any((depths > 0.1) & (depths < 0.3))  # panes
    assert built.triangles[..., 2].max() > 9.0


def test_pavement_is_raised_and_marks_lie_on_the_road():
    mesh = MeshBuilder(np.random.default_rng(4))
    street.add_pavement(mesh, (0.0, 0.0, 10.0, 5.0))
    assert mesh.build().triangles[..., 2].max() == pytest.approx(street.KERB_HEIGHT, abs=0.005)
    mesh = MeshBuilder(np.random.default_rng(4))
    street.add_street(mesh, placed(0.0, 0.0, 0.0), 60.0, (30.0,), np.random.default_rng(4))
    marks = mesh.build().triangles
    assert 0.0 < marks[..., 2].min() <= marks[..., 2].max() < 0.01  # thin as paint, and never in one plane
    assert np.abs(marks[..., 1]).max() <= street.HALF_ROAD + 1e-6


@pytest.mark.slow
def test_narrow_blocks_have_no_yard_but_stand():
    assert len(build_town.__wrapped__(7)[0].triangles) > 10_000  # its second block is less than two houses deep
