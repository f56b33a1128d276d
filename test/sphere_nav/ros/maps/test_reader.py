"""A map comes back as it was saved; anything else is refused with its reason."""

import gc
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Message
from sphere_nav_msgs.msg import MapInfo

from sphere_nav.ros.bags import BagError, BagReader, BagWriter
from sphere_nav.ros.bags.mcap_file import read_chunk
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.reader import COARSE, EXPERIENCE, FEATURES, GRAPH, INFO, SPHERE, MapDetails, open_map, save_map
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.experiences import Service, with_experience, with_service
from sphere_nav.spheres.graph import Experience, SphereGraph
from worlds.maps import load_all

DETAILS = MapDetails(map_id="yard", source="drive", parameters={"mapper.levels": 4}, rig="cameras: []")


@pytest.fixture
def saved(sphere_graph, tmp_path):
    return save_map(tmp_path / "map", sphere_graph, DETAILS)


def test_a_map_comes_back_and_all_spheres_are_read_small_at_once(saved, sphere_graph):
    with open_map(saved) as reader:
        assert reader.info.map_id == "yard"
        assert reader.info.num_spheres == 3
        length = sum(edge.T_a_b.distance(edge.T_a_b.identity())[0] for edge in sphere_graph.edges)
        assert reader.info.length == pytest.approx(length)
        assert reader.parameters == {"mapper.levels": 4}
        assert all(node.sphere is None for node in reader.graph)
        graph, found = load_all(reader), reader.coarse_spheres()
    for before, after in zip(sphere_graph, graph, strict=True):
        assert (after.id, after.stamp_ns) == (before.id, before.stamp_ns)
        np.testing.assert_allclose(after.T_map_sphere.matrix, before.T_map_sphere.matrix, atol=1e-12)
        np.testing.assert_array_equal(after.sphere.image, before.sphere.image)
        np.testing.assert_allclose(after.sphere.range_m, before.sphere.range_m, rtol=1.1e-4)  # of the logarithmic code
        assert after.sphere.camera == before.sphere.camera
    for before, after in zip(sphere_graph.edges, graph.edges, strict=True):
        assert (after.a, after.b, after.is_loop) == (before.a, before.b, before.is_loop)
        np.testing.assert_allclose(after.information, before.information, rtol=1e-6)
    assert list(found) == [node.id for node in sphere_graph]
    for node in sphere_graph:
        expected = coarse_sphere(node.sphere)
        np.testing.assert_array_equal(found[node.id].image, expected.image)
        np.testing.assert_allclose(found[node.id].range_m, expected.range_m, rtol=1.1e-4)


@pytest.mark.parametrize("told", ["kitchen.yaml", [0, 0, 1, 0, 0], [0, 0, "high", 0, 0, 0], [0, 0, 4e3, 0, 0, 0], 7])
def test_spheres_that_sit_nowhere_on_a_vehicle_are_refused(told, sphere_graph, tmp_path):
    path = save_map(tmp_path / "map", sphere_graph, MapDetails(parameters={"sphere_on_base": told}))
    with open_map(path) as reader, pytest.raises(BagError, match=r"map: sphere_on_base: expected"):
        _ = reader.T_base_sphere


def test_a_map_is_a_bag_with_one_chunk_a_sphere(saved):
    with BagReader(saved) as bag:
        counts = {INFO: 2, SPHERE: 3, COARSE: 3, FEATURES: 3, GRAPH: 2, EXPERIENCE: 1}
        assert {name: info.count for name, info in bag.topics.items()} == counts
        file = bag.files[0]
        channel = next(c.id for c in file.summary.channels.values() if c.topic == SPHERE)
        of_spheres = [index for index in file.summary.chunk_indexes if channel in index.message_index_offsets]
        assert len(of_spheres) == 3
        records = [read_chunk(file.stream, index.chunk_start_offset) for index in of_spheres]
        assert [sum(isinstance(record, Message) for record in chunk) for chunk in records] == [1, 1, 1]


def test_two_savings_are_the_same_bytes(sphere_graph, tmp_path):
    first, second = (save_map(tmp_path / name, sphere_graph, DETAILS) / "map.mcap" for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()


def test_an_old_map_stays_until_the_new_one_is_complete_and_nothing_else_is_replaced(saved, sphere_graph):
    (saved / "notes.txt").write_text("dear")
    neighbour = save_map(saved.with_name("map.old"), sphere_graph)
    before, beside = (saved / "map.mcap").read_bytes(), (neighbour / "map.mcap").read_bytes()
    with pytest.raises(BagError, match="nothing is overwritten"):
        save_map(saved, sphere_graph)
    without_pictures = SphereGraph([*open_map(saved).graph])
    with pytest.raises(BagError, match="key sphere 10: expected its picture in memory"):
        save_map(saved, without_pictures, is_overwriting=True)
    assert (saved / "map.mcap").read_bytes() == before
    save_map(saved, SphereGraph([node for node in sphere_graph if node.id != 12]), is_overwriting=True)
    assert len(open_map(saved).graph) == 2
    assert (saved / "notes.txt").read_text() == "dear"
    assert (neighbour / "map.mcap").read_bytes() == beside
    assert sorted(path.name for path in saved.parent.iterdir()) == ["map", "map.old"]
    assert sorted(path.name for path in saved.iterdir()) == ["map.mcap", "metadata.yaml", "notes.txt"]


@pytest.mark.dds
def test_a_process_killed_while_it_saves_leaves_a_whole_map(saved, sphere_graph, rng):
    small = SphereGraph([node for node in sphere_graph if node.id != 12])
    for number in range(4):
        child = os.fork()
        if child == 0:
            gc.disable()  # what the parent's threads hold cannot be collected here
            try:
                for graph in [small, sphere_graph] * 1000:
                    save_map(saved, graph, is_overwriting=True)
            finally:
                os._exit(1)
        time.sleep(0.02 + 0.05 * rng.random())
        os.kill(child, signal.SIGKILL)
        assert os.WIFSIGNALED(os.waitpid(child, 0)[1]), "it was still saving"
        with open_map(saved) as reader:
            assert len(load_all(reader)) in (2, 3), number
        for left in saved.parent.glob("map.new*"):  # what a message asks the user to look at
            shutil.rmtree(left)


def test_a_folder_that_is_no_map_is_never_replaced_and_an_empty_graph_is_no_map(sphere_graph, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "dear.jpg").touch()
    with pytest.raises(BagError, match="nothing is overwritten"):
        save_map(tmp_path / "photos", sphere_graph, is_overwriting=True)
    assert (tmp_path / "photos" / "dear.jpg").exists()
    with pytest.raises(BagError, match="found an empty one"):
        save_map(tmp_path / "map", SphereGraph())


def rewritten(saved, path, change):
    """Copy a map, each serialized message through `change(topic, message) -> list of messages`."""
    with BagReader(saved) as bag, BagWriter(path, file_name="map.mcap") as out:
        for topic, stamp, message in bag.messages():
            for item in change(topic, message):
                out.flush()
                out.write(topic, item, stamp)
    return path


def test_experiences_come_back_and_older_maps_have_one(saved, sphere_graph, tmp_path):
    night = Experience("night", "rgbd 64 x 48", "drive_2", 5)
    graph = with_service(with_experience(sphere_graph, night, [11]), {11: Service(3, 77)})
    with open_map(save_map(tmp_path / "two", graph, DETAILS)) as reader:
        found = {node.id: (node.experience, node.served, node.last_served_ns) for node in reader.graph}
    nothing = (Experience(), 0.0, 0)
    assert found == {10: nothing, 11: (night, 3.0, 77), 12: nothing}
    old = rewritten(saved, tmp_path / "old", lambda topic, message: [] if topic == EXPERIENCE else [message])
    with open_map(old) as reader:
        assert {node.experience for node in reader.graph} == {Experience()}


def with_field(wanted, **fields):
    def change(topic, message):
        if topic == wanted:
            for name, value in fields.items():
                setattr(message, name, value)
        return [message]

    return change


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (with_field(INFO, format_version=9), "format_version: expected 1, found 9"),
        (with_field(INFO, num_spheres=4_000_000_000), r"graph: expected 4000000000 vertices \(info\), found 3"),
        (with_field(INFO, num_spheres=4), r"graph: expected 4 vertices \(info\), found 3"),
        (with_field(INFO, parameters="a: ["), "parameters: expected YAML"),
        (with_field(GRAPH, vertices=[]), "graph: edge 10-11: expected both ends in the graph"),
        (with_field(EXPERIENCE, ids=[10, 11]), "experience 'the first drive': expected as many ids, served"),
        (with_field(EXPERIENCE, ids=[10, 11, 99]), "experience 'the first drive': expected key spheres of the graph"),
        (with_field(EXPERIENCE, ids=[10, 11, 11]), "each once, and finite numbers of images, found 11"),
        (with_field(EXPERIENCE, served=[0.0, float("nan"), 0.0]), "finite numbers of images, found 11, nan"),
        (lambda topic, message: [] if topic == GRAPH else [message], "expected topic /map/graph"),
        (lambda topic, message: [] if topic == INFO else [message], "expected topic /map/info"),
        (lambda topic, message: [] if getattr(message, "id", 0) == 11 else [message], "spheres: expected 3 .* found 2"),
    ],
)
def test_a_map_that_contradicts_itself_is_refused(saved, tmp_path, change, reason):
    with pytest.raises(BagError, match=reason) as error:
        open_map(rewritten(saved, tmp_path / "bad", change))
    assert "bad" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("fields", "reason"), [({"id": 99}, "sphere 11, found 99"), ({"range": b"\x00"}, "key sphere 11: range: expected")]
)
def test_a_sphere_that_is_wrong_is_refused_when_it_is_read(saved, tmp_path, fields, reason):
    def change(topic, message):
        return with_field(SPHERE, **fields)(topic, message) if getattr(message, "id", 0) == 11 else [message]

    with open_map(rewritten(saved, tmp_path / "bad", change)) as reader:
        reader.load_sphere(10)
        with pytest.raises(BagError, match=reason):
            reader.load_sphere(11)


def test_the_format_is_frozen():
    """A map of format 1, by the program that wrote it first: three spheres of 160 x 80 of the simulated town."""
    path = Path(__file__).parent / "format_1"
    assert MapInfo.FORMAT_VERSION == 1
    assert verify_map(path) == []
    with open_map(path) as reader:
        assert (reader.info.map_id, reader.info.source, reader.info.rig) == ("street", "drive", "name: test\n")
        assert reader.parameters == {"origin": "the first sphere", "seed": 5}
        assert [node.id for node in reader.graph] == [0, 1, 2]
        assert len(reader.graph.edges) == 2
        assert len(reader.appearance().features) == 3
        assert set(reader.coarse_spheres()) == {0, 1, 2}
        sphere = reader.load_sphere(1)
    ratio = sphere.range_std_m / sphere.range_m
    is_near = np.isfinite(sphere.range_m) & (sphere.range_m > 1.2)
    np.testing.assert_allclose(ratio[:30][is_near[:30]], 0.01, rtol=0.02)
    assert np.isnan(ratio[30:34]).all()


def test_spheres_that_are_elsewhere_are_fetched(saved, tmp_path):
    with open_map(saved) as reader:
        save_map(tmp_path / "copy", reader.graph, DETAILS, load_sphere=reader.load_sphere)
        with open_map(tmp_path / "copy") as copy:
            np.testing.assert_array_equal(copy.load_sphere(11).range_m, reader.load_sphere(11).range_m)
