"""Views of a map whose key spheres come and go."""

import threading
import time

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, synthesize
from worlds.localizer import MemoryMap, make_map
from worlds.patience import wait_until
from worlds.room import optical

MIN_KEPT = 4  # written out: imported, a change would go unseen

PINHOLE = Pinhole(160, 120, 100.0, 100.0, 79.5, 59.5)
PLACES = [SE3.from_planar(x, 0.0, 0.3 * i) for i, x in enumerate(np.linspace(-2.5, 2.5, 8))]


@pytest.fixture(scope="module")
def sphere_map(room):
    return make_map(room, PLACES, Spherical(256, 128))


@pytest.mark.parametrize("num_kept", [0.5, 5.5])
def test_it_sees_the_room_and_keeps_to_its_memory(room, sphere_map, num_kept):
    scene = Scene(sphere_map, num_kept * 1e-6 * surface_of(sphere_map.load_sphere(0)).num_bytes)
    for x in np.linspace(-2.4, 2.4, 6):
        T = optical(SE3.from_planar(x, 0.2, 0.2))
        view = scene.render(T, PINHOLE)
        gray, _ = room.render(PINHOLE, T)
        assert view.is_known.mean() > 0.97
        assert np.median(np.abs(view.image[..., 0] - gray)) < 6
    assert max(MIN_KEPT, num_kept - 1) <= len(scene._surfaces) <= max(MIN_KEPT, num_kept) + 1
    scene.close()


def test_without_waiting_it_shows_what_is_ready(sphere_map):
    scene = Scene(sphere_map)
    here, there = (optical(PLACES[i]) for i in (0, 7))
    scene.render(here, PINHOLE)
    assert scene.is_ready(here)
    view = scene.render(there, PINHOLE, is_waiting=False)
    assert view.is_known.mean() > 0.2  # the farthest sphere stands in, or the right ones were ready in time
    scene.render(there, PINHOLE)
    assert scene.is_ready(there)
    scene.close()


def test_an_unreadable_sphere_is_told_and_asked_for_again(sphere_map):
    class Torn(MemoryMap):
        is_torn = True

        def load_sphere(self, sphere_id):
            if self.is_torn:
                raise ValueError("torn")
            return super().load_sphere(sphere_id)

    torn = Torn(sphere_map.graph)
    scene = Scene(torn)
    with pytest.raises(ValueError, match="torn"):
        scene.render(optical(PLACES[0]), PINHOLE)
    torn.is_torn = False
    assert scene.render(optical(PLACES[0]), PINHOLE).is_known.any()
    scene.close()


class Counting(MemoryMap):
    """A map that counts what is read of it, and lets the key spheres that it holds back wait."""

    def __init__(self, graph, held=()):
        super().__init__(graph)
        self.reads, self.held, self.gate = [], set(held), threading.Event()

    def load_sphere(self, sphere_id):
        if sphere_id in self.held:
            self.gate.wait(20.0)
        self.reads.append(sphere_id)
        return super().load_sphere(sphere_id)


def test_two_key_spheres_are_read_for_a_view_and_each_once(sphere_map):
    source = Counting(sphere_map.graph)
    scene = Scene(source)
    for _ in range(3):
        scene.render(optical(PLACES[3]), PINHOLE)
    assert len(scene._surfaces) == len(source.reads) == len(set(source.reads)) == 2
    assert source.reads[0] == 3
    scene.close()


def test_where_no_more_spheres_are_the_farthest_has_half_its_weight(sphere_map):
    """The one left out stands twice as far away: by distances 1/2 and 3/2 weights (1 - 1/6) / (1/2), (1/2) / (3/2)."""
    spheres, places = [sphere_map.graph[i].sphere for i in (0, 1)], [SE3.from_planar(x, 0.0, 0.0) for x in (0.5, -1.5)]
    nodes = [KeySphere(i, 1, T, sphere) for i, (T, sphere) in enumerate(zip(places, spheres, strict=True))]
    scene, T = Scene(MemoryMap(SphereGraph(nodes))), optical(SE3.identity())
    placed = map(PlacedSurface, map(surface_of, spheres), places, (5 / 6, 1 / 6))
    np.testing.assert_array_equal(scene.render(T, PINHOLE).image, synthesize(list(placed), T, PINHOLE).image)
    scene.close()


def test_the_nearest_that_is_ready_stands_in_for_what_is_not(sphere_map):
    source = Counting(sphere_map.graph, held=(6, 7))
    scene = Scene(source)
    for T in (optical(PLACES[0]), optical(PLACES[4])):
        assert wait_until(lambda T=T: scene.is_ready(T), 20.0, lambda: time.sleep(1e-3))
    prepared = set(source.reads)
    T = optical(PLACES[7])
    view = scene.render(T, PINHOLE, is_waiting=False)
    nearest = sphere_map.graph[max(prepared)]
    alone = PlacedSurface(surface_of(source.load_sphere(nearest.id)), nearest.T_map_sphere)
    np.testing.assert_array_equal(view.image, synthesize([alone], T, PINHOLE).image)
    source.gate.set()
    scene.close()


def test_a_map_of_many_days_is_drawn_in_one_of_them():
    camera, day, night = Spherical(64, 32), Experience("day"), Experience("night")
    nodes = [
        KeySphere(k, 1, SE3.from_planar(x, 0.0, 0.0), flat_sphere(camera, level), experience=one)
        for k, (x, level, one) in enumerate([(0.0, 200, day), (0.5, 40, night), (-0.5, 40, night)])
    ]
    scene = Scene(MemoryMap(nodes))
    assert scene.experiences == (day, night)
    pose = optical(SE3.from_planar(0.0, 0.0, 0.0))
    levels = [scene.render(pose, PINHOLE, one).image[60, 80, 0] for one in (None, day, night)]
    assert levels[1:] == [200, 40]
    assert levels[0] > 150  # the nearest one
    assert scene.is_ready(pose, night)
    scene.close()


def flat_sphere(camera, level):
    size = camera.height, camera.width
    return Sphere(np.full(size, level, np.uint8), np.full(size, 3.0, np.float32), camera)
