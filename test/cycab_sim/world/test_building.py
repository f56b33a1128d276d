"""A house is whole from the street: holes of its front are closed, trims sit about openings, nothing floats."""

from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.world import building
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


@pytest.mark.parametrize("seed", [0])
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


def front_of(seed, **style):
    """Return the parts of a front of three storeys by itself, and its style."""
    mesh, rng = Recorder(np.random.default_rng(seed)), np.random.default_rng(seed)
    given = replace(building.random_style(rng), **style)
    height = building.GROUND_STOREY + 2 * given.storey + 0.5
    building._add_front(mesh, HERE, WIDTH, height, 3, given, rng)
    return mesh.parts, given, height


@pytest.mark.parametrize("is_shop", [True])
@pytest.mark.parametrize("seed", [0])
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
