"""Views of a map whose key spheres come and go."""

from itertools import pairwise

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.view_synthesis.scene import MIN_KEPT, Scene
from worlds.localizer import MemoryMap, make_map
from worlds.room import optical

PINHOLE = Pinhole(160, 120, 100.0, 100.0, 79.5, 59.5)
PLACES = [SE3.from_planar(x, 0.0, 0.3 * i) for i, x in enumerate(np.linspace(-2.5, 2.5, 8))]


@pytest.fixture(scope="module")
def sphere_map(room):
    return make_map(room, PLACES, Spherical(256, 128))


def test_it_sees_the_room_and_keeps_to_its_memory(room, sphere_map):
    scene = Scene(sphere_map, max_megabytes=0.5)
    for x in np.linspace(-2.4, 2.4, 12):
        T = optical(SE3.from_planar(x, 0.2, 0.2))
        view = scene.render(T, PINHOLE)
        grey, _ = room.render(PINHOLE, T)
        assert view.is_known.mean() > 0.97
        assert np.median(np.abs(view.image[..., 0] - grey)) < 6
    assert MIN_KEPT <= len(scene._surfaces) <= MIN_KEPT + 1
    scene.close()


def test_nothing_jumps_where_spheres_are_exchanged(sphere_map):
    scene = Scene(sphere_map)
    x = 0.5 * (PLACES[2].translation[0] + PLACES[3].translation[0])
    views = [
        scene.render(optical(SE3.from_planar(x + d, 0.3, 0.0)), PINHOLE).image.astype(float)
        for d in (-3e-4, -1e-4, 1e-4, 3e-4)  # the third nearest sphere becomes the second at 0
    ]
    steps = [np.median(np.abs(a - b)) for a, b in pairwise(views)]
    assert max(steps) <= 1.0
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


def test_an_empty_map_is_refused_and_one_sphere_is_enough(sphere_map):
    with pytest.raises(ValueError, match="empty"):
        Scene(MemoryMap([]))
    node = sphere_map.graph[0]
    scene = Scene(MemoryMap(SphereGraph([KeySphere(5, 1, node.T_map_sphere, node.sphere)])))
    assert scene.render(optical(PLACES[0]), PINHOLE).is_known.mean() > 0.97
    scene.close()
