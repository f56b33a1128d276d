"""A house is whole from the street: holes of its front are closed, trims sit about openings, nothing floats."""

import numpy as np

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


def test_a_house_keeps_to_its_plot_and_nothing_floats():
    mesh, height, _ = house(0)
    low, high = (f([part.bounds[i] for part in mesh.parts], axis=0) for i, f in ((0, np.min), (1, np.max)))
    assert np.all(low >= [-0.12, -1.0, -1e-9])
    assert np.all(high <= [WIDTH + 0.12, DEPTH + 0.36, height + 0.42 * DEPTH + 1.3])
    assert low[2] == 0.0
    assert {part.finish.kind for part in floating(mesh.parts)} <= {k.SIGN}  # one that hangs out over the pavement
    assert floating(mesh.parts, 0.101) == []
    for part in mesh.parts:
        if len(part.quads) in (5, 6):
            assert part.looks_outward()
