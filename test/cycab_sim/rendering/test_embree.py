import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from cycab_sim.rendering.embree import PacketScene


@pytest.mark.parametrize("num_origins", [1, 3001])
def test_packets_meet_what_single_rays_meet(box_mesh, rng, num_origins):
    num, packets, single = 3001, PacketScene(box_mesh.triangles, first=7), EmbreeScene(robust=True)
    _ = TriangleMesh(single, box_mesh.triangles)
    rays = rng.normal(size=(num, 3)).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    origins = rng.uniform((-1.0, -1.0, 0.5), (1.0, 1.0, 2.0), (num_origins, 3)).astype(np.float32)
    starts = np.ascontiguousarray(np.broadcast_to(origins, (num, 3)))
    expected = single.run(starts, rays, query="INTERSECT", output=1)
    rays[::5] = np.nan  # outside of a lens
    triangles, ranges = packets.cast(origins, rays)
    assert (triangles[::5] == -1).all()
    assert (ranges[::5] == np.inf).all()
    inside, is_hit = np.arange(num) % 5 > 0, expected["primID"] >= 0
    np.testing.assert_array_equal(triangles[inside], np.where(is_hit, expected["primID"] + 7, -1)[inside])
    met = inside & is_hit
    np.testing.assert_allclose(ranges[met], expected["tfar"][met], rtol=1e-6)
    assert met.sum() > 500
