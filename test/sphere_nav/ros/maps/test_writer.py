"""A map that is written as it grows is whole at its end, and can be mended whenever the process dies."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps import writer as map_writer
from sphere_nav.ros.maps.check import salvage_map, verify_map
from sphere_nav.ros.maps.reader import COARSE, MapDetails, MapWriter, open_map, save_map
from sphere_nav.ros.maps.writer import write_stored
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import SphereGraph
from worlds.maps import load_all

DETAILS = MapDetails(map_id="yard", source="drive", parameters={"mapper.levels": 4}, rig="cameras: []")


def grow(writer, graph):
    """Write key spheres as they are kept, and tell the graph so far with each."""
    nodes, ids = [], set()
    for node in sorted(graph, key=lambda node: node.id):
        writer.add(node, node.sphere)
        nodes.append(node)
        ids.add(node.id)
        writer.tell(SphereGraph(nodes, [edge for edge in graph.edges if {edge.a, edge.b} <= ids]))


def test_a_grown_map_is_the_map(sphere_graph, tmp_path):
    writer = MapWriter(tmp_path / "map", DETAILS)
    grow(writer, sphere_graph)
    for node in sphere_graph:
        np.testing.assert_array_equal(writer.load(node.id).image, node.sphere.image)
    moved = sphere_graph.with_poses({node.id: SE3.from_planar(1, 2, 3) @ node.T_map_sphere for node in sphere_graph})
    assert writer.finish(moved) == tmp_path / "map"
    whole = save_map(tmp_path / "whole", moved, DETAILS)
    with open_map(tmp_path / "map") as found, open_map(whole) as expected:
        assert found.info == expected.info
        for node in load_all(expected):
            assert found.graph[node.id].T_map_sphere.distance(node.T_map_sphere)[0] < 1e-9
            np.testing.assert_array_equal(found.load_sphere(node.id).range_m, node.sphere.range_m)
        assert [(e.a, e.b) for e in found.graph.edges] == [(e.a, e.b) for e in expected.graph.edges]
        assert found.appearance().words.keys() == expected.appearance().words.keys()
    assert verify_map(tmp_path / "map") == []
    assert [path.name for path in tmp_path.iterdir() if "partial" in path.name] == []


def test_key_spheres_of_an_older_drive_keep_what_they_look_like(sphere_graph, tmp_path, rng):
    index = AppearanceIndex()
    for node in sphere_graph:
        rays = rng.normal(size=(5, 3))
        rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
        index.add(node.id, Features(rays, np.full(5, 2.0, np.float32), rng.integers(0, 256, (5, 128), np.uint8)))
    stamps = {node.id: 10**9 - node.stamp_ns // 100 for node in sphere_graph}
    spheres = {node.id: replace(node.sphere, stamp_ns=stamps[node.id]) for node in sphere_graph}
    nodes = [replace(node, stamp_ns=stamps[node.id], sphere=spheres[node.id]) for node in sphere_graph]
    older = SphereGraph(nodes, sphere_graph.edges)
    with open_map(save_map(tmp_path / "map", older, appearance=index)) as found:
        assert [node.stamp_ns for node in found.graph] == [node.stamp_ns for node in older]
        for node_id, features in found.appearance().features.items():
            np.testing.assert_array_equal(features.descriptors, index.features[node_id].descriptors)
        assert list(found.coarse_spheres()) == list(older.nodes)
        assert [int(small.id) for _, small in found.stored()] == list(older.nodes)


def test_small_spheres_are_chunks_that_can_be_read(sphere_graph, tmp_path):
    path = save_map(tmp_path / "map", sphere_graph)
    with BagReader(path) as bag:
        small = next(channel.id for channel in bag.files[0].summary.channels.values() if channel.topic == COARSE)
        chunks = [one for one in bag.files[0].summary.chunk_indexes if small in one.message_index_offsets]
        assert [set(index.message_index_offsets) for index in chunks] == [{small}] * 3
    with open_map(path) as found:
        assert list(found.coarse_spheres()) == list(sphere_graph.nodes)
    assert verify_map(path) == []


def test_what_was_not_added_cannot_be_read_and_the_graph_must_fit(sphere_graph, tmp_path):
    writer = MapWriter(tmp_path / "map")
    grow(writer, sphere_graph)
    with pytest.raises(BagError, match="key sphere 99: expected one that was written"):
        writer.load(99)
    with pytest.raises(BagError, match="graph: expected 4 key spheres, found 3 written"):
        writer.finish(SphereGraph([*sphere_graph, replace(next(iter(sphere_graph)), id=99)]))
    writer.discard()
    assert list(tmp_path.iterdir()) == []


def test_an_existing_map_is_replaced_only_by_a_complete_one(sphere_graph, tmp_path):
    path = save_map(tmp_path / "map", sphere_graph)
    with pytest.raises(BagError, match="nothing is overwritten"):
        MapWriter(path)
    writer = MapWriter(path, is_overwriting=True)
    grow(writer, sphere_graph)
    with pytest.raises(BagError, match=r"map\.new\.partial: a run that is still writing"):
        MapWriter(path, is_overwriting=True)
    assert len(open_map(path).graph) == 3
    assert writer.finish(sphere_graph) == path
    assert [entry.name for entry in tmp_path.iterdir()] == ["map"]


def until_the_disk_is_full(stored):
    yield stored[0]
    raise OSError("full")


def test_a_map_is_written_of_some_of_the_spheres_of_others(sphere_graph, tmp_path):
    def shifted(by):
        nodes = [replace(node, id=node.id + by) for node in sphere_graph]
        return SphereGraph(nodes, [replace(edge, a=edge.a + by, b=edge.b + by) for edge in sphere_graph.edges])

    newer = shifted(100)
    save_map(tmp_path / "base", sphere_graph)
    save_map(tmp_path / "newer", newer)
    dropped = max(newer.nodes)
    nodes = [*sphere_graph, *(node for node in newer if node.id != dropped)]
    edges = [edge for edge in [*sphere_graph.edges, *newer.edges] if dropped not in (edge.a, edge.b)]
    graph = SphereGraph(nodes, edges)
    with open_map(tmp_path / "base") as base, open_map(tmp_path / "newer") as other:
        stored = [*base.stored(), *other.stored()]
    assert write_stored(tmp_path / "both", graph, DETAILS, None, stored) == tmp_path / "both"
    assert verify_map(tmp_path / "both") == []
    with open_map(tmp_path / "both") as found:
        assert list(found.graph.nodes) == sorted(node.id for node in nodes)
        assert found.info.map_id == "yard"
        for node in nodes:
            np.testing.assert_array_equal(found.load_sphere(node.id).image, node.sphere.image)
        assert found.coarse_spheres().keys() == found.graph.nodes.keys() == found.appearance().words.keys()
    with pytest.raises(BagError, match="graph: expected 5 key spheres, found 3 written"):
        write_stored(tmp_path / "none", graph, DETAILS, None, stored[:3])
    with pytest.raises(OSError, match="full"):
        write_stored(tmp_path / "none", graph, DETAILS, None, until_the_disk_is_full(stored))
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["base", "both", "newer"]


@pytest.mark.parametrize("num_kept", [1, 2, 3])
def test_a_torn_map_is_mended_up_to_its_last_graph(sphere_graph, tmp_path, monkeypatch, num_kept):
    monkeypatch.setattr(map_writer, "GRAPH_EVERY", 1)
    writer = MapWriter(tmp_path / "map", DETAILS)
    kept = sorted(sphere_graph, key=lambda node: node.id)[:num_kept]
    ids = {node.id for node in kept}
    grow(writer, SphereGraph(kept, [edge for edge in sphere_graph.edges if {edge.a, edge.b} <= ids]))
    assert salvage_map(tmp_path / "map.partial", tmp_path / "mended") == num_kept
    with open_map(tmp_path / "mended") as found:
        assert found.parameters == {"mapper.levels": 4}
        for node in kept:
            assert found.graph[node.id].T_map_sphere.distance(node.T_map_sphere)[0] < 1e-9
        edges = [(e.a, e.b) for e in sphere_graph.edges if {e.a, e.b} <= ids]
        assert sorted((e.a, e.b) for e in found.graph.edges) == sorted(edges)
    writer.discard()


def test_the_graph_is_written_again_every_few_key_spheres(sphere_graph, tmp_path):
    node, told = next(iter(sphere_graph)), []
    writer = MapWriter(tmp_path / "map", DETAILS)
    for number in range(10):
        told.append(replace(node, id=number))
        writer.add(told[-1], node.sphere)
        writer.tell(SphereGraph(told))
        kept = salvage_map(tmp_path / "map.partial", tmp_path / f"mended_{number}")
        assert kept == number // 4 * 4 + 1
    writer.discard()
