"""A seed is one world for ever: recorded maps, drives and figures are of it, whatever else changes in the code."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from cycab_sim.params import SeasonParams, TrafficParams
from cycab_sim.world import building, city, furniture, street, town
from cycab_sim.world.mesh import Mesh, MeshBuilder, joined, placed
from cycab_sim.world.texture import kernels as k
from cycab_sim.world.traffic import figures, loops
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import GroundProfile, World, build_world, geometry_cloud

AT = placed(3.0, -2.0, 0.7, 0.12)
BLOCK = (3.75, 3.75, 41.0, 31.0)
PLAN = town.draw_plan(5)
SECOND = 1_000_000_000


def drawn(add: Callable[..., None], *given, seeds=range(4), at=None, **season) -> Mesh:
    """Return what one function adds for each of some seeds, at a placement."""
    meshes = []
    for seed in seeds:
        mesh = MeshBuilder(np.random.default_rng(seed), SeasonParams(**season))
        add(mesh if at is None else mesh.within(at), *given)
        meshes.append(mesh.build())
    return joined(meshes)


@cache
def block(**season) -> Mesh:
    """A block of houses with its streets, and all that stands in them."""
    mesh = MeshBuilder(np.random.default_rng(2), SeasonParams(**season))
    street.add_ground(mesh, BLOCK)
    street.add_pavement(mesh, BLOCK)
    for sides in ("ssss", "qsal"):
        town.add_houses(mesh, BLOCK, sides)
        town.furnish(mesh, BLOCK, sides)
    street.add_street(mesh.at(0.0, 0.0, 0.3), 80.0, (20.0, 60.0))
    town.add_skyline(mesh, BLOCK)
    return mesh.build()


@cache
def traffic() -> Traffic:
    path = town.taught_path(PLAN, "two_turns")
    world = World(block(), GroundProfile(), path, PLAN.bounds, loops.town_loops(PLAN)[::2])
    return Traffic(world, TrafficParams(density="usual", standing_at=20.0, may_cross=True), 5)


def made(figure: Callable[[np.random.Generator], figures.Figure]) -> list[object]:
    some = [figure(np.random.default_rng(seed)) for seed in range(3)]
    parts = [part for one in some for part in one.parts]
    numbers = [(p.ahead, p.base, *p.pivot, p.swing, p.wave, p.phase, p.roll) for p in parts]
    return [joined([part.mesh for part in parts]), numbers, [(one.half_length, one.half_width) for one in some]]


def ways(some: tuple[loops.Loop, ...]) -> list[object]:
    return [
        np.concatenate([loop.points for loop in some]),
        [(loop.z, loop.is_crossing, loop.has_rails) for loop in some],
    ]


def paths() -> list[object]:
    some = [*(town.taught_path(PLAN, name) for name in ("two_turns", "block", "straight")), city.tour()]
    return [path.at(np.linspace(-3.0, path.length + 3.0, 300)) for path in some]


THINGS = {
    **{kind: lambda kind=kind: [drawn(getattr(furniture, f"add_{kind}"), at=AT)]
       for kind in ("car", "lamp", "traffic_sign", "bollard", "box", "bench", "tree", "monument", "kiosk")},
    "hedge": lambda: [drawn(furniture.add_hedge, 2.0, at=AT)],
    "house": lambda: [drawn(building.add_house, 9.0, 8.0, 3, seeds=range(8), at=AT)],
    "row": lambda: [drawn(town.add_row, 60.0, 9.0, at=AT)],
    "block": lambda: [block()],
    "square": lambda: [drawn(city._add_square, seeds=range(1))],
    "rails and views": lambda: [drawn(city._add_rails), drawn(city._close_views, seeds=[0])],
    **{kind: lambda kind=kind: [build_world(kind, 3).mesh] for kind in ("corridor", "ramp")},
    "cloud": lambda: [geometry_cloud(3, 0.5, "corridor")],
    "views": lambda: [drawn(town._close_views, PLAN, seeds=[0])],
    "town": lambda: [town.build_town(5, SeasonParams())[0]],
    "parked cars": lambda: [drawn(town.furnish, BLOCK, parked=2)],
    "autumn": lambda: [drawn(furniture.add_tree, at=AT, leaves="yellow")],
    "winter": lambda: [drawn(furniture.add_tree, at=AT, leaves="none")],
    **{kind: lambda kind=kind: made(getattr(figures, f"make_{kind}")) for kind in ("tram", "pedestrian", "cyclist")},
    "ways": lambda: ways(loops.town_loops(PLAN)) + ways(loops.city_loops()),
    "paths": paths,
    "traffic": lambda: [traffic().mesh, *(traffic().poses(k * SECOND) for k in (0, 77))],
    "who keeps off": lambda: [traffic().poses(SECOND, np.array([[5.0, 5.0], [20.0, 1.0]]), 2.0)],
}  # fmt: skip
NUMBERS = {
    "corridor": 3.116093, "ramp": -1.895655,
    "car": -0.413985, "lamp": -0.200262, "traffic_sign": -2.906653, "bollard": -1.567814, "box": -4.480856,
    "bench": -3.368204, "tree": -6.473656, "monument": -3.443701, "kiosk": -2.102228, "hedge": -5.368888,
    "house": 0.136372, "row": -5.615799, "block": -4.219475, "square": -1.214205,
    "rails and views": -0.236118, "cloud": -1.289453, "views": 3.602259, "town": 3.682713, "parked cars": -5.479565,
    "autumn": -7.383343, "winter": -1.477781, "tram": -2.724044, "pedestrian": 2.273996, "cyclist": -3.822752,
    "ways": 3.019920, "paths": 3.485482, "traffic": 7.601341, "who keeps off": -0.462488,
}  # fmt: skip


SLOW = {"town": pytest.mark.slow}


@pytest.mark.parametrize("thing", [pytest.param(one, marks=SLOW.get(one, ())) for one in THINGS])
def test_a_seed_draws_the_same_for_ever(fingerprint, thing):
    """Who changes a world on purpose writes the new number."""
    found = fingerprint(*THINGS[thing]())
    assert np.dot(found, 1.0 + 0.1 * np.arange(len(found))) == pytest.approx(NUMBERS[thing], abs=2e-6)


def test_a_season_changes_leaves_and_cars_alone():
    """All else of a town is drawn from the same numbers, however many a car or a lump of leaves takes."""
    for season in ({"parked": 2}, {"leaves": "none"}, {"leaves": "yellow"}):
        there, here = block(), block(**season)
        stays = [~mesh.is_clutter & ~np.isin(mesh.kinds[:, 0], [k.FOLIAGE, k.BARK]) for mesh in (there, here)]
        np.testing.assert_array_equal(here.frames[stays[1]], there.frames[stays[0]])
        assert not np.array_equal(here.colors, there.colors)
