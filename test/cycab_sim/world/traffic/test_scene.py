import numpy as np

from cycab_sim.params import TrafficParams
from cycab_sim.rendering.casting.embree import find_library
from cycab_sim.world.traffic.scene import MovingScene
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import build_world


def test_packets_and_single_rays_meet_the_same_traffic(rng):
    world = build_world("town", 5)
    traffic = Traffic(world, TrafficParams(is_on=True), 5)
    rays = rng.normal(size=(4000, 3)).astype(np.float32) * np.float32([1, 1, 0.1])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = []
    for library in (find_library(), None):
        scene = MovingScene(world.mesh, traffic, library)
        scene.move(traffic.poses(50_000_000_000))
        triangles, ranges = np.full(4000, -1, np.int32), np.full(4000, 40.0, np.float32)
        scene.cast_nearer(np.array([0.0, 20.0, 1.2]), rays, triangles, ranges)
        found.append((triangles, ranges))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-5)
    has_hit = found[0][0] >= scene.first
    assert 5 < has_hit.sum() < 4000
    assert np.all(found[0][1][~has_hit] == 40.0)
