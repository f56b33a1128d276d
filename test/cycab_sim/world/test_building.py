"""A house is whole from the street: holes of its front are closed, trims sit about openings, nothing floats."""

from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.world import building, finishes
from cycab_sim.world.mesh import placed
from cycab_sim.world.texture import kernels as k
from worlds.parts import Recorder, floating

HERE = placed(0.0, 0.0, 0.0)
WIDTH, DEPTH = 9.0, 8.0


def house(seed, storeys=3):
    """Return what a house is built of, and the height of its walls."""
    mesh = Recorder(np.random.default_rng(seed))
    building.add_house(mesh, HERE, WIDTH, DEPTH, storeys, np.random.default_rng(seed))
    style = building.random_style(np.random.default_rng(seed))
    return mesh, building.GROUND_STOREY + (storeys - 1) * style.storey + 0.5, style


@pytest.mark.parametrize("seed", range(8))
def test_a_house_keeps_to_its_plot_and_nothing_floats(seed):
    mesh, height, _ = house(seed)
    low, high = (f([part.bounds[i] for part in mesh.parts], axis=0) for i, f in ((0, np.min), (1, np.max)))
    assert np.all(low >= [-0.12, -1.0, -1e-9])
    assert np.all(high <= [WIDTH + 0.12, DEPTH + 0.36, height + 0.42 * DEPTH + 1.3])
    assert low[2] == 0.0
    assert {part.finish.kind for part in floating(mesh.parts)} <= {k.SIGN}  # one that hangs out over the pavement
    assert floating(mesh.parts, 0.101) == []
    for part in mesh.parts:
        if len(part.quads) in (5, 6):
            assert part.looks_outward()


@pytest.mark.parametrize("seed", range(8))
def test_what_is_drawn_on_a_panel_has_its_size(seed):
    """Windows, doors, signs and posters tell the texture their width and height."""
    sizes = {k.WINDOW: slice(1, 3), k.WOOD: slice(1, 3), k.SIGN: slice(1, 3)}
    checked = 0
    for part in house(seed)[0].parts:
        given = part.finish.params[sizes.get(part.finish.kind, slice(0))]
        if len(given) == 2:
            sides = np.linalg.norm(np.diff(part.quads, axis=1), axis=2)[:, :2]
            assert np.isclose(sides, given, atol=1e-6).all(axis=1).any()
            checked += 1
    assert checked > 10


def front_of(seed, **style):
    """Return the parts of a front of three storeys by itself, and its style."""
    mesh, rng = Recorder(np.random.default_rng(seed)), np.random.default_rng(seed)
    given = replace(building.random_style(rng), **style)
    height = building.GROUND_STOREY + 2 * given.storey + 0.5
    building._add_front(mesh, HERE, WIDTH, height, 3, given, rng)
    return mesh.parts, given, height


@pytest.mark.parametrize("is_shop", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_every_hole_of_a_front_is_closed(seed, is_shop):
    """Wall and openings together are the front, and each opening ends in a pane as deep as its reveal."""
    parts, style, height = front_of(seed, is_shop=is_shop)
    walls = [part for part in parts if part.finish is style.wall]
    panes = [part for part in parts if part.finish.kind in (k.WINDOW, k.WOOD)]
    area = sum(np.ptp(quad[:, 0]) * np.ptp(quad[:, 2]) for part in (*walls, *panes) for quad in part.quads)
    assert area == pytest.approx(WIDTH * height)
    num_bays = int(WIDTH / style.bay)
    assert len(panes) == 3 * num_bays
    assert sum(pane.finish.kind == k.WOOD for pane in panes) == 1  # the door
    reveals = [part for part in parts if len(part.quads) == 4]
    for pane, reveal in zip(panes, reveals, strict=True):
        assert pane.bounds[:, 1] == pytest.approx(style.reveal)
        np.testing.assert_allclose(reveal.bounds, [[*pane.bounds[0] * [1, 0, 1]], pane.bounds[1]], atol=1e-12)
        across = np.cross(reveal.quads[:, 1] - reveal.quads[:, 0], reveal.quads[:, 3] - reveal.quads[:, 0])
        inward = pane.points.mean(axis=0) - reveal.quads.mean(axis=1)
        assert np.all(np.sum(across * inward * [1, 0, 1], axis=1) > 0)  # seen from within the hole
    centers = np.sort([pane.bounds.mean(axis=0)[0] for pane in panes])[::3]
    np.testing.assert_allclose(centers, (np.arange(num_bays) + 0.5) * WIDTH / num_bays)
    sills = np.unique(np.round([pane.bounds[0, 2] for pane in panes], 9))
    first = 0.45 if is_shop else 0.95
    np.testing.assert_allclose(sills, [0.0, first, *(3.6 + i * style.storey + 0.8 for i in range(2))])
    tops = np.unique(np.round([pane.bounds[1, 2] for pane in panes], 9))
    np.testing.assert_allclose(tops, [2.7, *(3.6 + i * style.storey + 0.8 + style.window[1] for i in range(2))])


@pytest.mark.parametrize("seed", range(4))
def test_trims_sit_about_their_opening(seed):
    parts, style, _ = front_of(seed, is_shop=False, shutter=(0.1, 0.2, 0.1), has_ledges=False)
    begins = [i for i, part in enumerate(parts) if len(part.quads) == 4]
    for begin, end in zip(begins, [*begins[1:], begins[-1] + 6], strict=True):
        pane, *trims = [part for part in parts[begin + 1 : end] if part.finish is not style.wall]
        (x0, _, z0), (x1, _, z1) = pane.bounds
        is_door = pane.finish.kind == k.WOOD
        for trim in trims:
            assert trim.bounds[0, 1] < 0.0 <= trim.bounds[1, 1] + 1e-9 < 0.02  # before the wall, and on it
        if not is_door:
            lintel, sill, left, right = trims
            assert [left.bounds[1, 0], right.bounds[0, 0]] == pytest.approx([x0 - 0.02, x1 + 0.02])
            assert [left.bounds[:, 2], right.bounds[:, 2]] == pytest.approx(np.array([[z0, z1]] * 2))
            assert np.ptp(left.bounds[:, 0]) == pytest.approx((x1 - x0) / 2)  # they close
            assert sill.bounds[1, 2] == pytest.approx(z0)
        else:
            lintel, sill = trims[:2]
            assert sill.bounds[0, 2] == 0.0
        assert lintel.bounds[0, 2] == pytest.approx(z1)
        for trim in (lintel, sill):
            assert trim.is_symmetric(0, (x0 + x1) / 2)
            assert trim.bounds[0, 0] < x0 < x1 < trim.bounds[1, 0]


@pytest.mark.parametrize("add", [building._add_gable_roof, building._add_flat_roof])
def test_a_roof_covers_the_house_and_is_tight(add):
    for seed in range(4):
        mesh, rng = Recorder(np.random.default_rng(seed)), np.random.default_rng(seed)
        add(mesh, HERE, (WIDTH, DEPTH, 9.0), finishes.TRIM, rng)
        parts, is_gable = mesh.parts, add is building._add_gable_roof
        roof, chimney, cap = parts[0], parts[-2], parts[-1]
        assert np.all(roof.bounds[0, :2] <= 0.0)
        assert np.all(roof.bounds[1, :2] >= [WIDTH, DEPTH])
        assert roof.is_symmetric(0, WIDTH / 2)
        assert roof.is_symmetric(1, DEPTH / 2)
        assert chimney.is_symmetric(1, DEPTH / 2)
        assert cap.bounds[0, 2] == pytest.approx(chimney.bounds[1, 2])
        np.testing.assert_allclose(cap.bounds.mean(axis=0)[:2], chimney.bounds.mean(axis=0)[:2])
        assert np.all(np.ptp(cap.bounds, axis=0)[:2] > np.ptp(chimney.bounds, axis=0)[:2])
        if is_gable:
            ridge = roof.bounds[1, 2]
            assert 0.28 * DEPTH <= ridge - 9.0 <= 0.42 * DEPTH
            for quad in roof.quads:  # each slope passes over the top of its wall, and looks up
                across = np.cross(quad[1] - quad[0], quad[3] - quad[0])
                wall = np.array([0.0, 0.0 if quad[0, 1] < DEPTH / 2 else DEPTH, 9.0])
                assert np.dot(across, wall - quad[0]) == pytest.approx(0.0, abs=1e-9)
                assert across[2] > 0
            np.testing.assert_allclose(parts[1].bounds, [[0, 0, 9.0], [WIDTH, DEPTH, ridge]], atol=1e-9)
            assert chimney.bounds[0, 2] < ridge < chimney.bounds[1, 2]
        else:
            edges = parts[1:-2]
            assert sum(np.prod(np.ptp(edge.bounds, axis=0)[:2]) for edge in edges) == pytest.approx(
                WIDTH * DEPTH - (WIDTH - 0.5) * (DEPTH - 0.5)
            )
            np.testing.assert_allclose([edge.bounds[:, 2] for edge in edges], [[9.0, 9.6]] * 4)


def test_a_plain_wall_carries_its_posters_and_windows_on_it():
    for seed in range(4):
        mesh, rng = Recorder(np.random.default_rng(seed)), np.random.default_rng(seed)
        style = building.random_style(rng)
        building._add_plain_wall(mesh, HERE, WIDTH, 10.0, style, rng)
        wall, *rest = mesh.parts
        np.testing.assert_allclose(wall.bounds, [[0, 0, 0], [WIDTH, 0, 10.0]])
        assert len(rest) == 3 + len(np.arange(4.4, 8.2, style.storey))
        for part in rest:
            assert -0.021 <= part.bounds[0, 1] == part.bounds[1, 1] <= -0.01
            assert np.all(part.bounds[0, [0, 2]] >= [0.2, 0.4])
            assert np.all(part.bounds[1, [0, 2]] <= [WIDTH - 0.2, 10.0])
            assert part.finish.kind in (k.SIGN, k.WINDOW)
