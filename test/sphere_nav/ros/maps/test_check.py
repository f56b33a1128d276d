"""verify_map reads every sphere; salvage_map keeps those that are whole."""

import numpy as np
import pytest

from sphere_nav.ros.bags import BagError, BagReader, BagWriter
from sphere_nav.ros.maps.check import salvage_map, verify_map
from sphere_nav.ros.maps.reader import SPHERE, open_map, save_map
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import Experience


@pytest.fixture
def saved(sphere_graph, tmp_path):
    return save_map(tmp_path / "map", sphere_graph)


def sphere_chunks(saved):
    with BagReader(saved) as bag:
        summary = bag.files[0].summary
    channel = next(c.id for c in summary.channels.values() if c.topic == SPHERE)
    return [index for index in summary.chunk_indexes if channel in index.message_index_offsets]


def test_a_flipped_byte_is_found_and_its_sphere_left_out(saved, tmp_path):
    steps = []
    assert verify_map(saved, steps.append) == []
    assert steps == [1, 1, 1]
    index = sphere_chunks(saved)[1]
    data = bytearray((saved / "map.mcap").read_bytes())
    data[index.chunk_start_offset + index.chunk_length // 2] ^= 1
    (saved / "map.mcap").write_bytes(data)
    problems = verify_map(saved)
    assert len(problems) == 1
    assert f"byte {index.chunk_start_offset}" in problems[0]
    assert salvage_map(saved, tmp_path / "saved") == 2
    with open_map(tmp_path / "saved") as reader:
        assert [node.id for node in reader.graph] == [10, 12]
        assert reader.graph.edges == ()


def test_a_map_cut_while_it_was_written_keeps_its_whole_spheres(saved, sphere_graph, tmp_path):
    data = (saved / "map.mcap").read_bytes()
    for number, index in enumerate(sphere_chunks(saved)):
        (tmp_path / "cut.mcap").write_bytes(data[: index.chunk_start_offset + index.chunk_length - 1])
        with pytest.raises(BagError, match="truncated MCAP"):
            open_map(tmp_path / "cut.mcap")
        if number == 0:
            with pytest.raises(BagError, match="expected readable parts of a map of format"):
                salvage_map(tmp_path / "cut.mcap", tmp_path / "saved0")
            continue
        assert salvage_map(tmp_path / "cut.mcap", tmp_path / f"saved{number}") == number
        with open_map(tmp_path / f"saved{number}") as reader:
            node = reader.graph[10]
            np.testing.assert_allclose(node.T_map_sphere.matrix, sphere_graph[10].T_map_sphere.matrix, atol=1e-12)
        assert verify_map(tmp_path / f"saved{number}") == []


def test_a_key_sphere_whose_bytes_are_none_is_left_out(saved, tmp_path):
    with BagReader(saved) as bag, BagWriter(tmp_path / "odd", file_name="map.mcap") as odd:
        spheres = [item.message for item in bag.raw([SPHERE])]
        for name, info in bag.topics.items():
            odd.add_topic(name, info.type, info.profile)
        for topic, stamp, data in bag.raw():
            odd.write_bytes(topic, data[:20] if data == spheres[1] else data, stamp)
            odd.flush()
    assert salvage_map(tmp_path / "odd", tmp_path / "saved") == 2
    with open_map(tmp_path / "saved") as reader:
        assert [node.id for node in reader.graph] == [10, 12]


def test_a_map_without_its_info_is_salvaged_by_its_graph(saved, tmp_path):
    first = min(sphere_chunks(saved), key=lambda index: index.chunk_start_offset).chunk_start_offset
    data = bytearray((saved / "map.mcap").read_bytes())
    data[first // 2] ^= 1  # in the chunk of MapInfo and of the first graph
    (saved / "map.mcap").write_bytes(data)
    with pytest.raises(BagError):
        open_map(saved)
    assert salvage_map(saved, tmp_path / "saved") == 3
    assert verify_map(tmp_path / "saved") == []


def test_a_torn_map_keeps_the_names_of_its_experiences(sphere_graph, tmp_path):
    night = Experience("night", "rgbd 24 x 10", "drive_2", 7)
    save_map(tmp_path / "map", with_experience(sphere_graph, night, [11, 12]))
    with open_map(tmp_path / "map") as reader:
        assert [node.experience for node in reader.graph] == [Experience(), night, night]
    data = (tmp_path / "map" / "map.mcap").read_bytes()
    last = sphere_chunks(tmp_path / "map")[2].chunk_start_offset
    (tmp_path / "cut.mcap").write_bytes(data[:last])
    assert salvage_map(tmp_path / "cut.mcap", tmp_path / "saved") == 2
    with open_map(tmp_path / "saved") as reader:
        assert [node.experience for node in reader.graph] == [Experience(), night]
