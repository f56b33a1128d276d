import numpy as np
import pytest

from cycab_sim.params import SeasonParams
from cycab_sim.world.season import change_season


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
