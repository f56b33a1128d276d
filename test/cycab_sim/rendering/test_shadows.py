from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cycab_sim.rendering.embree import PacketScene
from cycab_sim.rendering.shadows import ShadowMap

SUN = np.array([0.6, 0.0, 0.8])
FLYING = np.array([[[-6.0, -6.0, 9.0], [-5.0, -6.0, 9.0], [-6.0, -5.0, 9.0]]], np.float32)


def test_a_shadow_goes_with_what_casts_it(box_mesh):
    with ThreadPoolExecutor(1) as pool:
        shadows = ShadowMap(PacketScene(box_mesh.triangles), (28.0, 0.25), SUN, np.zeros(3), pool)
        still = shadows.still.copy()
        shadows.draw(FLYING)
        first = shadows.depths < still
        shadows.draw(FLYING + np.float32([0.0, 3.0, 0.0]))
    assert 4 < first.sum() < 40  # half a square metre in texels, and a fringe
    np.testing.assert_array_equal(shadows.depths[first], still[first])
