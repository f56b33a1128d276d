import numpy as np
import pytest

from cycab_sim.params import SeasonParams
from cycab_sim.world.season import change_season
from cycab_sim.world.texture import kernels as materials


def faces(mesh, keep):
    """Return the triangles of some surfaces."""
    return mesh.triangles[keep[mesh.surface_of]]


@pytest.mark.slow
def test_other_cars_are_parked_and_nothing_else_moves(town):
    mesh = town[0]
    one, two, again = (change_season(mesh, SeasonParams(parked=n), 5) for n in (1, 2, 1))
    np.testing.assert_array_equal(one.triangles, again.triangles)
    cars = [{triangle.tobytes() for triangle in faces(m, m.is_parked)} for m in (mesh, one, two)]
    assert all(len(some) > 1000 for some in cars)
    assert not cars[0] & cars[1]
    assert not cars[1] & cars[2]
    np.testing.assert_array_equal(faces(mesh, ~mesh.is_parked), faces(one, ~one.is_parked))
    middles = one.triangles[one.is_parked[one.surface_of]].mean(axis=1)
    near = np.linalg.norm(middles[:, None, :2] - mesh.slots[None, :, :2, 3], axis=2).min(axis=1)
    assert near.max() < 2.8  # half a car, and the shift along the kerb


@pytest.mark.slow
def test_bare_trees_have_branches_for_leaves_and_houses_stay(town):
    mesh, bare = town[0], change_season(town[0], SeasonParams(leaves="none"), 5)
    is_leaf = mesh.kinds[:, 0] == materials.FOLIAGE
    assert (bare.kinds[is_leaf, 0] == materials.BARK).mean() > 0.5  # the others are hedges
    np.testing.assert_array_equal(mesh.kinds[~is_leaf], bare.kinds[~is_leaf])
    np.testing.assert_array_equal(faces(mesh, ~is_leaf), faces(bare, ~is_leaf))
    assert len(bare.triangles) < len(mesh.triangles)
    twigs = bare.triangles[(bare.kinds[:, 0] == materials.BARK)[bare.surface_of] & is_leaf[bare.surface_of]]
    assert twigs[..., 2].min() > 1.5
    assert np.all(np.isfinite(bare.normals))
