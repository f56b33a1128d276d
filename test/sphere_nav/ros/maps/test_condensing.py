"""Key spheres of a map, condensed."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.maps.condensing import condense, condense_message, count_bytes, count_compressed
from sphere_nav.ros.maps.reader import MapDetails, open_map, save_map
from sphere_nav.ros.maps.writer import write_stored
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A map of three key spheres in colour, with noise; the last one does not see all around."""
    rng = np.random.default_rng(3)
    camera, nodes = Spherical(256, 128, 256.0), []
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    for k in range(3):
        waves = 100.0 + 60.0 * np.sin(u / (5.0 + k))[..., None] * np.sin(v / 7.0)[..., None] * [1.0, 0.8, 0.5]
        image = np.clip(waves + rng.normal(0.0, 2.0, (*u.shape, 3)), 1, 255).astype(np.uint8)
        range_m = (5.0 + np.cos(u / 40.0) + rng.normal(0.0, 0.05, u.shape)).astype(np.float32)
        if k == 2:
            image[:40], range_m[:40] = 0, np.nan
        nodes.append(KeySphere(3 * k, k, SE3.from_planar(float(k), 0.0, 0.0), Sphere(image, range_m, camera, k)))
    return save_map(tmp_path_factory.mktemp("maps") / "map", SphereGraph(nodes))


def test_some_key_spheres_are_condensed_and_the_others_stay_bit_for_bit(folder, tmp_path):
    with open_map(folder) as base:
        graph = base.graph
        stored = condense(base.stored(), {0, 6})
        write_stored(tmp_path / "small", graph, MapDetails(), base.appearance(), stored)
        with open_map(tmp_path / "small") as small:
            told = 0.0
            for sphere_id in graph.nodes:
                before, after = base.load_message(sphere_id), small.load_message(sphere_id)
                known, found = base.load_sphere(sphere_id), small.load_sphere(sphere_id)
                assert (after == before) == (sphere_id == 3)
                told += count_bytes(base, sphere_id, sphere_id != 3)
                if sphere_id != 3:
                    assert count_compressed(after) < 0.6 * count_compressed(before)
                    assert np.abs(found.gray - known.gray).max() <= 0.51
                    np.testing.assert_array_equal(found.is_seen, known.is_seen)
            assert told == pytest.approx(small.num_bytes, rel=0.02)
            coarse, coarse_before = small.coarse_spheres(), base.coarse_spheres()
            np.testing.assert_array_equal(coarse[6].range_m, coarse_before[6].range_m)


def test_what_is_condensed_does_not_change_again(folder):
    with open_map(folder) as base:
        before = base.load_message(0)
        once = condense_message(before)
        assert once != before
        assert condense_message(once) == once


def test_the_whole_map_is_counted(folder):
    with open_map(folder) as base:
        whole = sum(count_bytes(base, sphere_id, False) for sphere_id in base.graph.nodes)
        assert whole == pytest.approx(base.num_bytes)
