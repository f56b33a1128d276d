"""The map from above."""

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.view.server import COLORS, SIDE, Minimap

PLACES = [SE3.from_planar(x, y, 0.0) for x, y in ((0, 0), (20, 0), (20, 20))]


def has(picture, color, u, v):
    return (picture[v - 2 : v + 3, u - 2 : u + 3] == color).all(axis=-1).any()


def test_key_spheres_and_loops_lie_where_they_are():
    edges = [Edge(0, 1, SE3.identity(), np.eye(6)), Edge(0, 2, SE3.identity(), np.eye(6), is_loop=True)]
    minimap = Minimap(SphereGraph([KeySphere(i, i, T) for i, T in enumerate(PLACES)], edges))
    picture = minimap.draw(PLACES[1] @ T_BODY_OPTICAL)
    pixels = [minimap.pixel(T) for T in PLACES]
    assert pixels[0][0] < pixels[1][0] == pixels[2][0]
    assert pixels[0][1] == pixels[1][1] > pixels[2][1]
    assert has(picture, COLORS["key"], *pixels[2])
    assert has(picture, COLORS["camera"], *pixels[1])
    assert has(picture, COLORS["camera"], pixels[1][0] + 10, pixels[1][1])  # it looks along x
    assert has(picture, COLORS["loops"], SIDE // 2, SIDE // 2)


def test_one_sphere_and_a_look_straight_down_are_drawn():
    minimap = Minimap(SphereGraph([KeySphere(0, 0, PLACES[0])]))
    assert has(minimap.draw(SE3.exp([0, 0, 0, np.pi, 0, 0])), COLORS["camera"], *minimap.pixel(PLACES[0]))
