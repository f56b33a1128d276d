"""Maps of segments become one graph: by the instant that they share, else by what can be aligned."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("rclpy")


from sphere_mapping.graph.keyframes import Track
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping.joining import Bridge, SegmentPart, join_segments
from sphere_nav_tools.offline.mapping.segment_work import SegmentRecord
from worlds.room import wide_room

CAMERA = Spherical(256, 128)
WAY = [SE3.from_planar(-0.8 + 0.3 * k, 0.1, 0.1 * k) for k in range(7)]
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def spheres():
    room = wide_room()
    return [replace(room.sphere(place, CAMERA, 3), stamp_ns=(k + 1) * SECOND) for k, place in enumerate(WAY)]


def part_of(path, spheres, numbers, *, num_lost=0):
    """Write the map of a segment in the frame of its first sphere; its tracks are its key spheres."""
    first = WAY[numbers[0]].inverse()
    nodes = [KeySphere(k, (n + 1) * SECOND, first @ WAY[n], spheres[n], 1.0) for k, n in enumerate(numbers)]
    edges = [Edge(a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere, np.eye(6)) for a, b in pairwise(nodes)]
    tracks = [Track(node.stamp_ns, node.id, SE3.identity()) for node in nodes]
    return SegmentPart(save_map(path, SphereGraph(nodes, edges)), SegmentRecord(tracks, num_lost))


def is_whole(joined, first_id=0):
    """Check that everything is where it was taken, by the first sphere, once and in order."""
    assert list(joined.graph.nodes) == [first_id + k for k in range(len(WAY))]
    for place, node in zip(WAY, joined.graph, strict=True):
        assert node.T_map_sphere.distance(WAY[0].inverse() @ place)[0] < 0.01
        np.testing.assert_array_equal(joined.load(node.id).stamp_ns, node.stamp_ns)
    assert [track.stamp_ns for track in joined.tracks] == [(k + 1) * SECOND for k in range(len(WAY))]
    pairs = [(edge.a - first_id, edge.b - first_id) for edge in joined.graph.edges]
    assert pairs == [(k, k + 1) for k in range(len(WAY) - 1)]
    assert list(joined.index.features) == list(joined.graph.nodes)


def test_segments_are_joined_by_the_instant_that_they_share(spheres, tmp_path):
    """The second one has two key spheres of the time before, which are left out."""
    parts = [
        part_of(tmp_path / "a", spheres, [0, 1, 2, 3], num_lost=1),
        part_of(tmp_path / "b", spheres, [1, 2, 3, 4, 5, 6]),
    ]
    joined = join_segments(parts, first_id=10)
    is_whole(joined, 10)
    assert joined.num_lost == 1
    stored = list(joined.stored())
    assert [(whole.id, small.id) for whole, small in stored] == [(10 + k, 10 + k) for k in range(7)]
    joined.close()


@pytest.mark.slow
def test_an_edge_from_what_is_left_out_begins_at_the_shared_one(spheres, tmp_path):
    parts = [part_of(tmp_path / "a", spheres, [0, 1, 2, 3]), part_of(tmp_path / "b", spheres, [2, 3, 4, 5, 6])]
    graph = SphereGraph(
        [KeySphere(k, (k + 3) * SECOND, WAY[2].inverse() @ WAY[k + 2], spheres[k + 2], 1.0) for k in range(5)],
        [Edge(0, 1, WAY[2].inverse() @ WAY[3], np.eye(6)), Edge(0, 2, WAY[2].inverse() @ WAY[4], np.eye(6))]
        + [Edge(k, k + 1, WAY[k + 2].inverse() @ WAY[k + 3], np.eye(6)) for k in (2, 3)],
    )
    parts[1] = replace(parts[1], path=save_map(tmp_path / "c", graph))
    joined = join_segments(parts)
    is_whole(joined)
    edge = joined.graph.edges[3]
    np.testing.assert_allclose(edge.T_a_b.matrix, (WAY[3].inverse() @ WAY[4]).matrix, atol=1e-9)


def test_where_the_shared_instant_was_lost_the_next_one_is_aligned(spheres, tmp_path):
    parts = [part_of(tmp_path / "a", spheres, [0, 1, 2, 3]), part_of(tmp_path / "b", spheres, [4, 5, 6])]
    is_whole(join_segments(parts, bridge=Bridge(MapperParams())))
    joined = join_segments(parts)  # as a salvage does: nothing is aligned
    assert list(joined.graph.nodes) == [0, 1, 2, 3]
    assert joined.num_lost == 3


def test_a_segment_without_key_spheres_is_passed_over(spheres, tmp_path):
    parts = [part_of(tmp_path / "a", spheres, [0, 1, 2, 3]), SegmentPart(None, SegmentRecord(num_lost=5))]
    joined = join_segments([*parts, part_of(tmp_path / "b", spheres, [3, 4, 5, 6])])
    is_whole(joined)
    assert joined.num_lost == 5
    with pytest.raises(ValueError, match="key sphere 0: expected none after the last segment"):
        joined.add(joined.graph[0], [], spheres[0])
    joined.close()
    (tmp_path / "a" / "map.mcap").unlink()
    with pytest.raises(BagError, match=r"map\.mcap"):
        joined.load(0)


@pytest.mark.slow
def test_the_key_spheres_before_and_after_the_shared_one_are_aligned_too(spheres, tmp_path):
    """The edge from the shared one is off by 5 cm; the one across it takes most of that back."""
    parts = [part_of(tmp_path / "a", spheres, [0, 1, 2, 3]), part_of(tmp_path / "b", spheres, [3, 4, 5, 6])]
    off = SE3.from_planar(0.05, 0.0, 0.0)
    nodes = [KeySphere(k, (k + 4) * SECOND, WAY[3].inverse() @ WAY[k + 3], spheres[k + 3], 1.0) for k in range(4)]
    moved = [replace(node, T_map_sphere=off @ node.T_map_sphere) if node.id else node for node in nodes]
    edges = [Edge(a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere, np.eye(6)) for a, b in pairwise(moved)]
    parts[1] = replace(parts[1], path=save_map(tmp_path / "c", SphereGraph(moved, edges)))
    bare, spanned = join_segments(parts).graph, join_segments(parts, bridge=Bridge(MapperParams())).graph
    expected = WAY[2].inverse() @ WAY[4]
    errors = [(one[2].T_map_sphere.inverse() @ one[4].T_map_sphere).distance(expected)[0] for one in (bare, spanned)]
    assert errors[0] == pytest.approx(0.05)
    assert errors[1] < 0.01
    assert [(edge.a, edge.b) for edge in spanned.edges if edge not in bare.edges][-1] == (2, 4)
    assert not any(edge.is_loop for edge in spanned.edges)
