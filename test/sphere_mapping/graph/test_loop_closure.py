import numpy as np
import pytest

from sphere_geometry import SE3, Pinhole
from sphere_map.graph import Edge, KeySphere, SphereGraph
from sphere_mapping.acquisition.partial import sphere_from_rgbd
from sphere_mapping.graph.loop_closure import candidates, close_loops, verify
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import LoopParams, MapperParams
from worlds.room import optical, sharp_room

CAMERA = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
AT = SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])
PARAMS = MapperParams()


def sphere(T_room_sphere, seed=7):
    return sphere_from_rgbd(*sharp_room(seed=seed).rgbd(CAMERA, optical(T_room_sphere)), CAMERA)


def chain(*steps):
    nodes = [KeySphere(k, k, SE3.from_parts(np.eye(3), [x, 0.0, 0.0])) for k, x in enumerate(steps)]
    edges = [Edge(k, k + 1, SE3.identity(), np.eye(6)) for k in range(len(nodes) - 1)]
    return SphereGraph(nodes, edges)


def test_candidates_are_near_in_space_far_in_sequence_and_not_joined():
    graph = chain(0.0, 2.0, 4.0, 2.1, 0.1)
    found = [(older.id, newer.id) for older, newer in candidates(graph, LoopParams(min_steps=2))]
    assert found == [(1, 3), (0, 4)]
    graph.connect(Edge(0, 4, SE3.identity(), np.eye(6), is_loop=True))
    assert [(a.id, b.id) for a, b in candidates(graph, LoopParams(min_steps=2))] == [(1, 3)]
    assert not list(candidates(graph, LoopParams(min_steps=4)))


def pair(newer_sphere, T_believed):
    nodes = KeySphere(0, 0, AT), KeySphere(5, 5, T_believed)
    prepared = {
        0: PreparedSphere(sphere(AT), PARAMS.registration),
        5: PreparedSphere(newer_sphere, PARAMS.registration),
    }
    return *nodes, prepared


def test_a_true_loop_is_measured_from_a_drifted_pose():
    motion = SE3.exp([0.05, 0.02, 0.0, 0.0, 0.01, 0.02])
    older, newer, prepared = pair(sphere(AT @ motion), AT @ motion @ SE3.exp([0.05, -0.04, 0.02, 0, 0, 0.03]))
    edge = verify(older, newer, prepared, PARAMS)
    assert edge is not None
    assert edge.is_loop
    assert edge.T_a_b.distance(motion)[0] < 0.005


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_another_place_at_the_same_position_is_no_loop(seed):
    older, newer, prepared = pair(sphere(AT, seed=seed), AT)  # the same walls with another texture
    assert verify(older, newer, prepared, PARAMS) is None


def test_a_view_into_another_direction_is_no_loop():
    away = AT @ SE3.exp([0, 0, 0, 0, 0, np.pi])
    older, newer, prepared = pair(sphere(away), away)
    assert verify(older, newer, prepared, PARAMS) is None


def test_spheres_that_are_not_in_memory_are_left_alone():
    graph = chain(0.0, 2.0, 4.0, 2.1, 0.1)
    found = close_loops(graph, PARAMS)
    assert found.num_loops == 0
    assert found.graph is graph
