from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sphere_mapping.graph.loop_closure import (
    Candidate,
    LoopCloser,
    choose_candidate,
    joined_pairs,
    passed,
    seen_pairs,
)
from sphere_mapping.graph.optimum import optimize_map
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from worlds.room import sharp_room

PARAMS = MapperParams()
CAMERA = Spherical(256, 128)
HERE = SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])


def chain(*steps):
    nodes = [KeySphere(k, k, SE3.from_parts(np.eye(3), [x, 0.0, 0.0])) for k, x in enumerate(steps)]
    edges = [Edge(a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere, np.eye(6)) for a, b in pairwise(nodes)]
    return SphereGraph(nodes, edges)


def revisit(T_room_newer, T_believed, make=lambda T, n: sharp_room().sphere(T, CAMERA, n)):
    """A graph that saw a place, went 20 m on through two other rooms, and comes back; with its closer."""
    rooms = [make(HERE, 0), *(sharp_room(seed=90 + n).sphere(HERE, CAMERA, n) for n in (1, 2)), make(T_room_newer, 3)]
    T = [HERE, HERE @ SE3.from_planar(7, 0, 0), HERE @ SE3.from_planar(3, 5, 0), T_believed]
    nodes = [KeySphere(k, k, pose, sphere) for k, (pose, sphere) in enumerate(zip(T, rooms, strict=True))]
    edges = [Edge(k, k + 1, T[k].inverse() @ T[k + 1], np.eye(6)) for k in range(3)]
    graph = SphereGraph(nodes, edges)
    return graph, LoopCloser(PARAMS, lambda sphere_id: graph[sphere_id].sphere)


def look(graph, closer):
    return [closer.find(graph, PreparedSphere(node.sphere), node.id) for node in graph]


@pytest.mark.parametrize("turn", [np.pi / 2, np.pi], ids=["crossing", "opposite"])
def test_a_place_is_recognised_whatever_the_heading(turn):
    motion = SE3.exp([0.25, 0.2, 0.0, 0.0, 0.01, 0.0]) @ SE3.exp([0, 0, 0, 0, 0, turn])
    graph, closer = revisit(HERE @ motion, HERE @ motion @ SE3.exp([0.9, -0.9, 0, 0, 0, 0.05]))  # drifted
    *earlier, loop = look(graph, closer)
    assert earlier == [None, None, None]
    assert (loop.a, loop.b, loop.is_loop) == (0, 3, True)
    distance, angle = loop.T_a_b.distance(motion)
    assert distance < 0.01
    assert angle < np.radians(0.3)
    (again,) = closer.find_all(graph)  # by appearance alone: so far apart nothing is seen to be near
    assert (again.a, again.b) == (0, 3)
    assert again.T_a_b.distance(loop.T_a_b)[0] < 1e-9
    closed = optimize_map(graph.with_edges([loop]))
    before, after = (float(one[3].T_map_sphere.distance(HERE @ motion)[0]) for one in (graph, closed))
    assert after < 0.3 * before
    assert closer.find_all(closed) == []  # what is joined is not joined again


def test_a_place_where_the_graph_cannot_be_is_no_loop():
    motion = SE3.exp([0.25, 0.2, 0.0, 0.0, 0.01, 0.0])
    graph, closer = revisit(HERE @ motion, HERE @ SE3.from_planar(4.0, 0.0, 0.0))  # 4 sigma of 20 m are 1.5 m
    assert look(graph, closer)[3] is None


def test_another_place_at_the_same_position_is_no_loop():
    def other(T, number):
        return sharp_room(seed=1 if number else 7).sphere(T, CAMERA, number)  # the same walls, another texture

    graph, closer = revisit(HERE, HERE, other)
    assert look(graph, closer)[3] is None
    assert closer.find_all(graph) == []


def test_of_two_places_alike_none_is_taken_unless_drift_tells_them_apart():
    graph = chain(0.0, 8.0, 16.0, 24.0, 16.5)
    here, there = Candidate(2, SE3.from_planar(0.5, 0, 0), 60), Candidate(1, SE3.from_planar(0.5, 0, 0), 55)
    assert choose_candidate(graph, 4, [here, there]) == here  # 8 m are more than 4 sigma of 31 m
    far = chain(*np.linspace(0, 800, 101).tolist(), 16.5)  # after 1,600 m both could be
    assert choose_candidate(far, 101, [here, there]) is None
    assert choose_candidate(far, 101, [here, replace(there, num_inliers=20)]) == here
    assert choose_candidate(far, 101, []) is None
    near = Candidate(100, SE3.from_planar(-783.5, 0, 0), 58)  # 5 m beside `farther`, 784 m of way less: one place
    farther = Candidate(2, SE3.from_planar(5.5, 0, 0), 60)
    assert choose_candidate(far, 101, [near, farther]) == farther
    assert choose_candidate(far, 101, [replace(near, num_inliers=62), farther]) == replace(near, num_inliers=62)


def seen(graph, *, is_whole=True):
    return [(a.id, b.id) for a, b in seen_pairs(graph, graph, joined_pairs(graph), is_whole=is_whole)]


def test_second_and_third_neighbours_are_joined_and_what_was_passed_on_the_way_back():
    reach = [replace(node, region_radius_m=2.5) for node in chain(0.0, 0.8, 1.6, 2.4, 8.0, 1.7)]
    graph = SphereGraph(reach, chain(0.0, 0.8, 1.6, 2.4, 8.0, 1.7).edges)
    assert seen(graph) == [(0, 2), (1, 3), (0, 3), (2, 5), (3, 5)]  # 5 is joined with 4, which it does not see
    graph.connect(Edge(1, 3, SE3.from_planar(1.6, 0, 0), np.eye(6), is_loop=True))
    assert seen(graph) == [(0, 2), (0, 3), (2, 5), (3, 5)]
    graph.connect(Edge(0, 3, SE3.from_planar(2.4, 0, 0), np.eye(6), is_loop=True))
    assert seen(graph) == [(0, 2), (2, 5), (3, 5)]


def test_views_that_are_turned_away_are_not_joined_unless_they_see_all_around():
    turned = [SE3.from_planar(0.1 * k, 0.0, 0.45 * k) for k in range(4)]
    nodes = [KeySphere(k, k, T, region_radius_m=1.0) for k, T in enumerate(turned)]
    graph = SphereGraph(nodes, [Edge(k, k + 1, turned[0].inverse() @ turned[1], np.eye(6)) for k in range(3)])
    assert seen(graph) == [(0, 2), (1, 3), (0, 3)]
    assert seen(graph, is_whole=False) == []  # 0.2 m and 0.9 rad


def test_what_the_way_has_passed_does_not_depend_on_how_many_key_spheres_stand_on_it():
    spacing = 0.5
    there = np.arange(0.0, 8.1, spacing)
    graph = chain(*there, *(there[::-1][1:]))  # 8 m on, and back
    newest = len(graph) - 1
    before = passed(graph, newest, 1.0)
    ways = np.array([abs(newest - sphere_id) * spacing for sphere_id in before])
    # On the way out, x m from here, 16 m - x back: 16 - x < 4 x, so x > 3.2 m.
    assert sorted(before) == list(range(min(before), newest))
    assert ways.max() < 12.8 <= ways.max() + spacing
    assert 0 not in before


def test_a_map_of_nothing_has_no_loops():
    """The call close_loops may come before the first sphere."""
    assert LoopCloser(PARAMS, {}.__getitem__).find_all(SphereGraph([], [])) == []
