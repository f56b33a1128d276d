"""Key spheres on disk as they are kept."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams, SphereMapperParams
from sphere_mapping.ros.saving import Journal, journal_path
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.params import build
from sphere_nav.ros.maps.check import salvage_map
from sphere_nav.ros.maps.reader import MapWriter, open_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from worlds.room import wide_room

CAMERA = Spherical(256, 128)
PLACES = [SE3.from_planar(-1.0 + 0.5 * k, 0.1, 0.1 * k) for k in range(5)]


def journal_in(folder, told=None):
    told = [] if told is None else told
    params = build(SphereMapperParams, {"map_folder": str(folder), "mapper.key.max_parallax_whole": 0.1})
    return Journal(params, told.append)


def drive(journal):
    """Return a mapper that has seen the room; every sphere is a key sphere."""
    room = wide_room()
    mapper = Mapper(build(MapperParams, {"key.max_parallax_whole": 0.1}), store=journal)
    for number, place in enumerate(PLACES):
        sphere = room.sphere(place, CAMERA, number)
        mapper.add(type(sphere)(sphere.image, sphere.range_m, CAMERA, 1_000_000_000 * (number + 1)))
    return mapper


@pytest.fixture
def told():
    return []


@pytest.mark.slow
def test_what_was_not_saved_becomes_a_map_and_is_mended_where_the_process_was_killed(tmp_path, told):
    journal = journal_in(tmp_path, told)
    mapper = drive(journal)
    remains = shutil.copytree(tmp_path / "journal.partial", tmp_path / "killed" / "journal.partial")
    assert salvage_map(remains, tmp_path / "killed" / "mended") >= len(mapper.graph) - 3  # since the last graph
    with open_map(tmp_path / "killed" / "mended") as reader:
        np.testing.assert_array_equal(reader.load_sphere(0).image, mapper.load_sphere(0).image)
    journal.close(mapper)
    assert "were not saved: they are the map" in told[-1]
    with open_map(tmp_path / "journal") as reader:
        assert {node.id for node in reader.graph} == {node.id for node in mapper.graph}
        assert reader.graph[2].T_map_sphere.distance(mapper.graph[2].T_map_sphere)[0] < 1e-9
        assert len(reader.appearance()) == len(mapper.graph)
    assert journal_path(tmp_path) == tmp_path / "journal_2"  # nothing is overwritten


def test_key_spheres_that_a_full_disk_does_not_take_stay_in_memory_and_are_a_map_once_there_is_space(
    tmp_path, told, monkeypatch
):
    def fail(*_):
        raise OSError("no space")

    journal, sphere = journal_in(tmp_path, told), wide_room().sphere(PLACES[0], CAMERA, 0)
    graph = SphereGraph([KeySphere(number, number + 1, PLACES[number]) for number in range(3)])
    for node in graph:
        if node.id:
            monkeypatch.setattr(MapWriter, "add", fail)
        journal.add(node, sphere)
    assert len(told) == 2  # where the journal is, and once that it fails
    assert "no space: key spheres stay in memory; free space, save_map" in told[1]
    monkeypatch.undo()
    for number in range(3):
        np.testing.assert_array_equal(journal.load(number).image, sphere.image)
    journal.close(SimpleNamespace(graph=graph, appearance=None))
    assert [entry.name for entry in tmp_path.iterdir()] == ["journal_2"]
    with open_map(tmp_path / "journal_2") as reader:
        assert len(reader.graph) == 3


def test_a_journal_is_on_disk_from_the_first_key_sphere_on_until_all_is_in_a_map(tmp_path, told):
    journal, graph = journal_in(tmp_path, told), SphereGraph([KeySphere(0, 1, PLACES[0])])
    journal.tell(graph)
    assert f"key spheres are written to {tmp_path / 'journal.partial'}" in told[0]
    journal.is_saved = True
    journal.close(SimpleNamespace(graph=graph))
    assert list(tmp_path.iterdir()) == []
