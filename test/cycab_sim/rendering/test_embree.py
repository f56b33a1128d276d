import numpy as np
import pytest

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.embree import find_library
from cycab_sim.rendering.renderer import Renderer

pytestmark = pytest.mark.skipif(find_library() is None, reason="no Embree 4 with packets of eight rays")


def test_packets_meet_what_single_rays_meet(box_mesh, rng):
    renderer, num = Renderer(box_mesh, RenderParams(shadow_texel=0.5), LightParams()), 3001
    rays = rng.normal(size=(num, 3)).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays[::5] = np.nan  # outside of a lens
    found = []
    for packets in (renderer._packets, None):
        renderer._packets = packets
        triangles, ranges = np.empty(num, np.int32), np.empty(num, np.float32)
        renderer._cast(np.array([0.5, 0.2, 1.5]), rays, triangles, ranges)
        found.append((triangles, ranges))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-6)
    assert np.isfinite(found[0][1]).any()
