import numpy as np
import pytest

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.embree import PacketScene, find_library
from cycab_sim.rendering.renderer import Renderer

pytestmark = pytest.mark.skipif(find_library() is None, reason="no Embree 4 with packets of eight rays")


@pytest.mark.parametrize("num", [3001])
def test_packets_meet_what_single_rays_meet(box_mesh, rng, num):
    renderer = Renderer(box_mesh, RenderParams(shadow_texel=0.5), LightParams())
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
    assert num < 8 or np.isfinite(found[0][1]).any()


def test_a_scene_keeps_its_triangles():
    triangles = np.array([[[5, -1, -1], [5, 1, -1], [5, 0, 1]]], np.float32)
    scene = PacketScene(find_library(), triangles)
    triangles[:] = 0.0  # it has its own copy
    number, ranges = np.empty(2, np.int32), np.empty(2, np.float32)
    scene.cast(np.zeros(3), np.array([[1, 0, 0], [-1, 0, 0]], np.float32), number, ranges)
    assert number.tolist() == [0, -1]
    assert ranges == pytest.approx([5.0, np.inf], rel=1e-6)
