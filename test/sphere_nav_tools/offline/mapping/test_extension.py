"""`sphere_nav map --extend`: a second drive is joined to a map where both saw the same places, or refused."""

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.params import KeySphereParams, MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import se3_to_pose_stamped, sphere_to_message
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.reader import MapDetails, open_map, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping.extension import LocatedMapper, drive_localizer
from sphere_nav_tools.offline.mapping.learning import thin_map
from worlds.commands import call
from worlds.maps import load_all
from worlds.room import sharp_room

START, PERIOD = 1_000_000_000, 200_000_000
SETTINGS = ("--set", "mapper.key.max_parallax_whole=0.1")
ALL_KEPT = ("--set", "mapper.key.merge=false")
EAST = [SE3.from_planar(-2.0 + 0.35 * k, 0.2, 0.0) for k in range(4)]
WEST = [SE3.from_planar(-0.05 - 0.35 * k, -0.2, np.pi) for k in range(4)]  # the other way, half of it the same


def write_drive(path, room, poses, start):
    """Write what a camera that gives spheres sees, and where it truly is in the room."""
    with BagWriter(path) as bag:
        for number, pose in enumerate(poses):
            stamp = start + number * PERIOD
            sphere = replace(room.sphere(pose, Spherical(128, 64), number), stamp_ns=stamp)
            bag.write("sphere", sphere_to_message(sphere, "sphere_link"), stamp)
            bag.write("ground_truth/pose", se3_to_pose_stamped(pose, stamp, "map"), stamp)
    return path


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    write_drive(folder / "east", sharp_room(), EAST, START)
    write_drive(folder / "west", sharp_room(), WEST, START + 100 * PERIOD)
    write_drive(folder / "elsewhere", sharp_room(seed=1), WEST, START + 100 * PERIOD)
    write_drive(folder / "short", sharp_room(seed=1), WEST[:2], START + 100 * PERIOD)
    assert call("map", folder / "east", "-o", folder / "taught", "--anchor", "truth", *SETTINGS) == 0
    return folder


@pytest.fixture(scope="module")
def joint(drives, tmp_path_factory):
    folder, taught = tmp_path_factory.mktemp("joint"), drives / "taught" / "map.mcap"
    before = taught.read_bytes()
    words = ("--extend", drives / "taught", "--trajectory", folder / "west.tum", *SETTINGS, *ALL_KEPT)
    with redirect_stdout(StringIO()) as said:
        assert call("map", drives / "west", "-o", folder / "both", *words) == 0
    assert f"joined to {drives / 'taught'}" in said.getvalue()
    assert taught.read_bytes() == before
    return folder


@pytest.mark.slow
def test_two_drives_are_one_map_and_the_first_one_stays_as_it_is(drives, joint):
    assert sorted(path.name for path in joint.iterdir()) == ["both", "west.tum"]
    assert verify_map(joint / "both") == []
    with open_map(joint / "both") as both, open_map(drives / "taught") as taught:
        assert set(taught.graph.nodes) < set(both.graph.nodes)
        assert both.info.source == "east + west"
        truth = {START + k * PERIOD: pose for k, pose in enumerate(EAST)}
        truth |= {START + (100 + k) * PERIOD: pose for k, pose in enumerate(WEST)}
        errors = [float(node.T_map_sphere.distance(truth[node.stamp_ns])[0]) for node in both.graph]
        assert np.sqrt(np.mean(np.square(errors))) < 0.01  # m, of all key spheres: the map's frame is the truth's
        assert any(edge.is_loop for edge in both.graph.edges)
        assert min(both.graph[sphere_id].served for sphere_id in taught.graph.nodes) > 0.0  # in their own drive
    driven = read_tum(joint / "west.tum")
    assert max(float(a.distance(b)[0]) for a, b in zip(driven.T_map_body, WEST, strict=True)) < 0.02


@pytest.mark.slow
def test_processes_and_a_cluster_make_the_same_map_bit_for_bit(drives, joint, tmp_path, monkeypatch):
    class Client:
        def __init__(self, address, timeout):
            assert address == "tcp://here:8786"

        def scheduler_info(self):
            return {"workers": {"one": {}, "two": {}}}

        def get_executor(self, pure):
            return ThreadPoolExecutor(2)

        def close(self):
            pass

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=Client, KilledWorker=RuntimeError))
    joined = (drives / "west", "--extend", drives / "taught", *ALL_KEPT, "--jobs", 2)
    taught = (drives / "east", "--anchor", "truth", "--scheduler", "tcp://here:8786")
    for words, one in ((joined, joint / "both"), (taught, drives / "taught")):
        assert call("map", *words, "-o", tmp_path / one.name, *SETTINGS) == 0
        assert (tmp_path / one.name / "map.mcap").read_bytes() == (one / "map.mcap").read_bytes()


def refused(capsys, *words):
    assert call("map", *words) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    return said


@pytest.mark.slow
def test_a_drive_elsewhere_is_refused_with_what_was_tried(drives, tmp_path, capsys):
    words = (drives / "short", "-o", tmp_path / "both", *SETTINGS)
    assert call("map", *words, "--extend", drives / "taught") == 1
    said = capsys.readouterr().err
    assert "expected a drive by places of the map, found none that hold" in said
    assert "key spheres looked up" in said
    assert "the drive alone stays as the map" in said
    assert [file.name for file in tmp_path.iterdir()] == ["both.drive"]
    assert verify_map(tmp_path / "both.drive") == []


@pytest.mark.slow
def test_a_drive_in_another_light_becomes_an_experience_from_a_given_start(drives, tmp_path, capsys):
    """Other patterns on the same walls, which features do not know: ranges place it."""
    output, taught = tmp_path / "both", drives / "taught"
    words = ("--start", 0.4, -0.1, 3.0, "--experience", "night", *SETTINGS)
    assert call("map", drives / "elsewhere", "-o", output, "--extend", taught, *words) == 0
    assert "a start was given; ranges fit at" in capsys.readouterr().out
    assert verify_map(output) == []
    with open_map(output) as both, open_map(taught) as before:
        assert all(node.experience.drive == "east" for node in before.graph)
        night = [node for node in both.graph if node.id not in before.graph.nodes]
        assert {(node.experience.name, node.experience.drive) for node in night} == {("night", "elsewhere")}
        assert len(night) >= 3
        for node in night:
            assert node.T_map_sphere.distance(WEST[(node.stamp_ns - START) // PERIOD - 100])[0] < 0.03
        for node in before.graph:
            assert both.graph[node.id].T_map_sphere.distance(node.T_map_sphere)[0] < 1e-9
        thinned, told = thinned_to(both, 1)
    assert sum(node.served for node in night) == len(WEST)  # what no other key sphere placed
    assert {node.experience.name for node in thinned} == {"night"}  # the day's explained nothing of the last drive
    assert told == [f"{len(before.graph)} key spheres left for the budget"]
    assert call("map-info", output, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert [(one["name"], one["drive"]) for one in facts["experiences"]] == [("", "east"), ("night", "elsewhere")]
    assert facts["places_by_experiences"] == {"2": len(before.graph) + len(night)}


def thinned_to(reader, budget):
    """Return the graph of a map within a budget, and what is told."""
    key = SimpleNamespace(merge=False)
    tracks = [SimpleNamespace(key_id=min(reader.graph.nodes))]
    mapper = SimpleNamespace(params=SimpleNamespace(key=key), tracks=tracks, load_sphere=reader.load_sphere)
    return thin_map(mapper, reader, budget, reader.graph, np.zeros((0, 3)), ())


@pytest.mark.slow
def test_a_map_that_cannot_be_extended_is_refused_before_anything_is_mapped(drives, tmp_path, capsys):
    west, taught = drives / "west", drives / "taught"
    words = (west, "-o", tmp_path / "both", "--extend")
    said = refused(capsys, west, "-o", taught, "--overwrite", "--extend", taught)
    assert "expected another folder than that of --extend" in said
    assert "--anchor: expected first" in refused(capsys, *words, taught, "--anchor", "truth")
    assert "expected a map" in refused(capsys, *words, drives)
    with open_map(taught) as reader:
        graph = load_all(reader)
    save_map(tmp_path / "rig", graph, MapDetails(rig="name: another"))
    assert "--rig: expected that of the map, found none" in refused(capsys, *words, tmp_path / "rig")
    save_map(tmp_path / "old", graph, MapDetails(software="sphere_nav 0.0.1"))
    said = refused(capsys, *words, tmp_path / "old")
    assert "software: expected sphere_nav" in said
    assert "found sphere_nav 0.0.1" in said
    assert not (tmp_path / "both").exists()


PARAMS = MapperParams(key=KeySphereParams(max_parallax_whole=0.1))
SMALL = Spherical(256, 128)
WAY = [SE3.from_planar(0.05 + 0.08 * k, 0.05, 0.1) for k in range(8)]


@pytest.fixture(scope="module")
def known_room(tmp_path_factory):
    places = [SE3.from_planar(0.3 * k, 0.0, 0.0) for k in range(3)]
    nodes = [KeySphere(k, k, T, sharp_room().sphere(T, SMALL, k), 3.0) for k, T in enumerate(places)]
    return save_map(tmp_path_factory.mktemp("known_room") / "map", SphereGraph(nodes))


def locate(reader, *rooms):
    """Return the mapper after a drive through rooms, one after the other, the last one to the end."""
    localizer = drive_localizer(reader)
    mapper = LocatedMapper(reader, localizer, PARAMS)
    for number, pose in enumerate(WAY):
        room = rooms[min(number, len(rooms) - 1)]
        mapper.add(replace(room.sphere(pose, SMALL, 50 + number), stamp_ns=10**9 + number * 10**8))
    localizer.references.close()
    return mapper


def test_a_drive_that_the_map_explains_is_placed_and_adds_nothing(known_room):
    with open_map(known_room) as reader:
        mapper = locate(reader, sharp_room())
        images = mapper.images()
        assert len(images) == len(WAY)
        sure = [(image, pose) for image, pose in zip(images, WAY, strict=True) if image.located is not None]
        assert len(sure) >= 4  # the first ones are in probation
        for image, pose in sure:
            T_map_sphere = reader.graph[image.located.a].T_map_sphere @ image.located.T_a_sphere
            assert T_map_sphere.distance(pose)[0] < 0.01
            assert image.load_small().stamp_ns == image.track.stamp_ns
        assert mapper.unexplained() == set()
        assert sum(one.num_images for one in mapper.served.values()) == len(WAY)  # in probation, too


class HalfNew:
    """A room whose texture is half that of another one: tracked all around, but no camera would call it the same."""

    def sphere(self, pose, camera, stamp_ns):
        known, other = (sharp_room(seed=seed).sphere(pose, camera, stamp_ns) for seed in (7, 1))
        mixed = (known.image.astype(np.uint16) + other.image) // 2
        return replace(known, image=mixed.astype(np.uint8))


@pytest.mark.slow
def test_a_place_that_is_tracked_but_looks_different_is_new(known_room):
    with open_map(known_room) as reader:
        mapper = locate(reader, HalfNew())
        assert sum(image.located is not None and image.located.is_sure for image in mapper.images()) >= 4
        assert mapper.unexplained() == set(mapper.graph.nodes)
        assert all(0.2 < mapper.lacking(image.track.stamp_ns) < 0.8 for image in mapper.images())
