from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sphere_mapping.graph.extension import Submap, agreeing, join_closely, join_graphs
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import KeySphereParams, MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from worlds.room import sharp_room

PARAMS = MapperParams(key=KeySphereParams(max_parallax_whole=0.1))
CAMERA = Spherical(256, 128)


def drive(room, poses, first_id=0, T_map_first=None):
    mapper = Mapper(PARAMS, T_map_first)
    mapper.first_id = first_id
    for number, pose in enumerate(poses):
        mapper.add(replace(room.sphere(pose, CAMERA, number), stamp_ns=number * 200_000_000))
    mapper.keep_end()
    return mapper


def submap(mapper):
    return Submap(mapper.graph, mapper.appearance, mapper.load_sphere)


EAST = [SE3.from_planar(-2.0 + 0.35 * k, 0.2, 0.0) for k in range(5)]


@pytest.fixture(scope="module")
def taught():
    return drive(sharp_room(), EAST, T_map_first=EAST[0])


@pytest.mark.slow
def test_key_spheres_of_a_drive_are_measured_against_those_of_the_map(taught):
    poses = [pose @ SE3.from_planar(0.1, -0.15, 0.02) for pose in EAST]
    newer = drive(sharp_room(), poses, first_id=100)
    truth = {node.id: poses[node.stamp_ns // 200_000_000] for node in newer.graph}
    rng = np.random.default_rng(3)
    located = []  # by a localizer that is off by 4 mm and 0.1 degrees on each axis
    for node in newer.graph:
        old = taught.graph.nearest(truth[node.id].translation)[0]
        off = SE3.exp(rng.normal(size=6) * np.repeat([0.004, 0.002], 3))
        T_a_b = old.T_map_sphere.inverse() @ truth[node.id] @ off
        located.append(Edge(old.id, node.id, T_a_b, np.diag(np.repeat([0.004, 0.002], 3) ** -2.0), is_loop=True))
    joined = join_graphs(taught.graph, newer.graph, located)
    closely = join_closely(submap(taught), submap(newer), joined)
    before, after = (
        np.mean([graph[node_id].T_map_sphere.distance(pose)[0] for node_id, pose in truth.items()])
        for graph in (joined, closely)
    )
    assert after < 0.5 * before
    assert all(closely[node.id].T_map_sphere is node.T_map_sphere for node in taught.graph)  # the map stays


def row(first_id, number):
    nodes = [KeySphere(first_id + k, k, SE3.from_planar(5.0 * k, 0, 0)) for k in range(number)]
    steps = pairwise(nodes)
    return SphereGraph(nodes, [Edge(a.id, b.id, SE3.from_planar(5.0, 0, 0), np.eye(6)) for a, b in steps])


def joined(a, b, x):
    return Edge(a, b, SE3.from_planar(x, 0.0, 0.0), np.eye(6), is_loop=True)


def test_places_must_agree_on_where_the_drive_is():
    base, newer = row(0, 10), row(100, 10)
    good = [joined(3, 100, 0.1), joined(4, 101, 0.1), joined(6, 103, 0.2), joined(9, 106, 0.3)]
    stray = joined(0, 104, 0.0)
    assert agreeing(base, newer, [*good[:2], stray, *good[2:]]) == good  # drift of 15 m may be as much
    assert agreeing(base, newer, good[:1]) == []
    assert agreeing(base, newer, [*good[:2], stray, joined(1, 105, 0.0)]) == []  # two say this, two say that
    assert agreeing(base, newer, []) == []
    assert agreeing(base, newer, [good[0], joined(4, 101, 1.2)]) == []  # 5 m do not drift by 1.1 m
