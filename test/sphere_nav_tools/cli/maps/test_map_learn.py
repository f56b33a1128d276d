"""A vehicle that learns by itself: drives that are kept, and the copy that is examined."""

import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

import dense_localizer.key_images as key_images
from dense_localizer.params import LocalizerParams
from dense_localizer.ros.drive_recorder import drives_of
from dense_localizer.ros.node import DenseLocalizerNode
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.reader import MapDetails, open_map, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.maps import map_learn
from sphere_nav_tools.cli.maps.map_learn import (
    KeyImage,
    count_explained,
    draw_range,
    explains,
    learn_map,
    list_drives,
    make_sphere,
    split_lesson,
)
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, WIDE_ROOM, picture, wide_map

START_NS = 1_000_000_000
NUM_IMAGES = 16
# The light of these lessons is one that local contrast would explain.
IN_GRAY = SMALL_IMAGES | {"alignment.contrast": False}
PARAMS = build(LocalizerParams, IN_GRAY | {"automatic": False})
SETTINGS = [word for name, value in IN_GRAY.items() for word in ("--set", f"{name}={value}")]
GLOW = 0.4 + 1.2 * np.cos(np.linspace(-1.5, 1.5, PINHOLE.width))  # a light ahead: it pulls to no side


def in_light(image):
    return np.clip(image * GLOW, 1, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def pictures():
    return [picture(number) for number in range(NUM_IMAGES)]


def see(map_path, pictures, start_ns=START_NS):
    """Localise a drive by a node that learns."""
    bus = OfflineBus(captured=set())
    bus.add(DenseLocalizerNode, {"map": str(map_path), "learn": True} | IN_GRAY)
    bus.publish("/tf_static", TFMessage(transforms=[se3_to_transform(SE3.identity(), start_ns, "base_link", "eye")]))
    bus.publish("/camera_info", camera_to_info(PINHOLE, start_ns, "eye"))
    for k, image in enumerate(pictures):
        stamp = start_ns + (k + 1) * STEP_NS
        list(bus.advance(stamp))
        bus.publish("/image_raw", array_to_image(image, stamp, "eye", "mono8"))
        list(bus.settle())
    bus.close()


@pytest.fixture(scope="module")
def taught(pictures, tmp_path_factory):
    """A map with two drives beside it: one that it explained, and one in another light."""
    path = tmp_path_factory.mktemp("maps") / "room"
    graph = wide_map(-2.0, -1.0, 0.0).graph
    stamped = {node.id: replace(node.sphere, stamp_ns=node.stamp_ns) for node in graph}
    graph = graph.with_nodes({k: {"region_radius_m": 2.0, "sphere": one} for k, one in stamped.items()})
    save_map(path, graph, MapDetails("abc", source="first"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(key_images, "KEY_REACH", 0.01)  # of a room that is 3 m wide
        patch.setattr(key_images, "MAX_KEY_SIGMA_M", 0.1)  # uneven light makes a pose uncertain
        see(path, pictures)
        see(path, [in_light(one) for one in pictures], 100 * START_NS)
    return path


@pytest.fixture
def campus(taught, tmp_path):
    for folder in (taught, drives_of(taught)):
        shutil.copytree(folder, tmp_path / folder.name)
    return tmp_path / taught.name


def test_a_drive_that_the_map_did_not_explain_is_the_lesson(taught, pictures):
    drives = list_drives(taught)
    assert [one.name for one in drives] == ["19700101_000001", "19700101_000140"]
    assert [key_images.is_lesson(one.explained) for one in drives] == [False, True]
    images = list(drives[1].images())
    assert len(images) == len(drives[1].explained)
    assert all(one.image.shape == (120, 160) and one.camera == PINHOLE for one in images)
    assert np.array_equal(images[0].image, in_light(pictures[1]))  # after probation


def test_an_image_that_is_learned_has_the_range_of_the_map(taught):
    image = next(iter(list_drives(taught)[1].images()))
    with open_map(taught) as base:
        sphere, T_map_sphere, covariance = make_sphere(base, image)
        drawn = draw_range(base, image)
    assert np.isfinite(drawn).mean() > 0.9
    true = WIDE_ROOM.sphere(T_map_sphere, sphere.camera, 0).range_m
    error = np.abs(sphere.range_m / true - 1.0)[sphere.measured]
    assert np.median(error) < 0.01  # 20 mm off, at 3 m
    assert sphere.measured.mean() > 0.5
    np.testing.assert_allclose(np.trace(covariance), np.trace(image.covariance))


@pytest.mark.slow
def test_a_map_learns_a_light_once(campus, capsys):
    before = {file.name: file.read_bytes() for file in campus.iterdir()}
    with open_map(campus) as base:
        taught, withheld = split_lesson(list_drives(campus)[1], base.graph)
    assert len(taught) < len(withheld)
    assert main(["map-learn", str(campus), *SETTINGS]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"{campus}: 1 of 1 drives learned"
    assert verify_map(campus) == []
    previous = campus.with_name(f"{campus.name}.previous")
    assert {file.name: file.read_bytes() for file in previous.iterdir()} == before
    with open_map(previous) as old, open_map(campus) as new:
        assert new.info.map_id == old.info.map_id == "abc"
        for node in old.graph:
            np.testing.assert_array_equal(node.T_map_sphere.matrix, new.graph[node.id].T_map_sphere.matrix)
            np.testing.assert_array_equal(old.load_sphere(node.id).range_m, new.load_sphere(node.id).range_m)
        added = [node for node in new.graph if node.id not in old.graph.nodes]
        assert len(added) == len(taught)
        assert {node.experience.drive for node in added} == {"19700101_000140"}
        assert {edge.b for edge in new.graph.edges} >= {node.id for node in added}
    assert count_explained((previous, campus), withheld, PARAMS) == [0, len(withheld)]
    assert main(["map-learn", str(campus), *SETTINGS]) == 1  # there is nothing left to learn


def test_a_key_image_joins_the_key_sphere_that_placed_it_to_5_mm_and_2_mrad():
    graph = SphereGraph(KeySphere(k, k, SE3.from_planar(float(k), 0.0, 0.5)) for k in (3, 4))
    node = KeySphere(9, 9, SE3.from_planar(3.2, 0.1, 0.7))
    for references, a in (((7, 4), 4), ((), 3)):  # one that is no more, none: the nearest
        one = KeyImage(5, np.zeros((2, 2), np.uint8), PINHOLE, SE3.identity(), np.eye(6), references, False)
        edge = map_learn._edge(graph, one, node, 1e-9 * np.eye(6))
        assert (edge.a, edge.b) == (a, 9)
        np.testing.assert_allclose((graph[a].T_map_sphere @ edge.T_a_b).matrix, node.T_map_sphere.matrix, atol=1e-12)
        sigmas = np.sqrt(np.diag(np.linalg.inv(edge.information)))
        np.testing.assert_allclose(sigmas, np.repeat([0.005, 0.002], 3), rtol=1e-3)


def see_marks(monkeypatch, *marks):
    """Say how many images maps explain, one after the other: withheld ones, then those of other drives."""
    counts = iter(marks)
    monkeypatch.setattr(map_learn, "count_explained", lambda *_: next(counts))


def test_a_map_that_makes_another_drive_worse_is_refused(campus, monkeypatch):
    before = (campus / "map.mcap").read_bytes()
    see_marks(monkeypatch, [0, 1], [1, 0])
    ((drive, is_taken, told),) = learn_map(campus, PARAMS)
    assert (drive, is_taken) == ("19700101_000140", False)
    assert "; 19700101_000001: explains 0 of " in told
    assert told.endswith(", before 1")
    assert (campus / "map.mcap").read_bytes() == before
    assert sorted(one.name for one in campus.parent.iterdir()) == [campus.name, drives_of(campus).name]


@pytest.mark.parametrize("moment", range(5))
def test_a_death_while_the_map_is_swapped_leaves_a_whole_one(tmp_path, monkeypatch, moment):
    """As if killed before the n-th change of a name; `.previous` of a run before may be lost, the map never is."""
    path, new = tmp_path / "map", tmp_path / "map.next"
    for folder, word in ((path, "old"), (new, "new"), (tmp_path / "map.previous", "older")):
        folder.mkdir()
        for name in ("map.mcap", "metadata.yaml"):
            (folder / name).write_text(f"{word} {name}")
    left = [moment]

    def dying(call):
        def step(*arguments, **values):
            if left[0] == 0:
                raise KeyboardInterrupt
            left[0] -= 1
            return call(*arguments, **values)

        return step

    with monkeypatch.context() as patch:
        for name in ("rmtree", "copytree"):
            patch.setattr(map_learn.shutil, name, dying(getattr(map_learn.shutil, name)))
        for name in ("replace", "rmdir"):
            patch.setattr(map_learn.Path, name, dying(getattr(map_learn.Path, name)))
        with pytest.raises(KeyboardInterrupt):
            map_learn.swap(path, new)
    word = (path / "map.mcap").read_text().split()[0]
    assert word == ("new" if moment >= 3 else "old")
    if moment >= 2:
        assert (tmp_path / "map.previous" / "map.mcap").read_text() == "old map.mcap"


@pytest.mark.parametrize(
    ("off_m", "sigma_m", "ncc", "is_explained"),
    [
        (0.09, 0.001, 0.9, True), (0.11, 0.001, 0.9, False),  # 0.1 m, however sure
        (0.23, 0.02, 0.9, True), (0.25, 0.02, 0.9, False),  # six standard deviations of both
        (0.01, 0.01, 0.79, False), (0.01, 0.01, 0.8, True), (None, 0.01, 0.9, False), (9.0, 0.01, 0.9, False),
    ],
)  # fmt: skip
def test_an_image_is_explained_where_it_was_and_if_it_looks_like_the_map(off_m, sigma_m, ncc, is_explained):
    covariance = np.diag([sigma_m**2, *[1e-12] * 5])
    one = KeyImage(5, np.zeros((2, 2), np.uint8), PINHOLE, SE3.identity(), covariance, (), is_explained=True)
    at = SE3.from_planar(off_m or 0.0, 0.0, 0.0)
    candidate = SimpleNamespace(is_accepted=off_m is not None, ncc=ncc, T_map_camera=at, covariance=covariance)

    def relocalize(pose):
        if off_m == 9.0:
            raise ValueError("no key sphere near")

    localizer = SimpleNamespace(
        reset=lambda: None, relocalize=relocalize, update=lambda *_: SimpleNamespace(candidate=candidate)
    )
    assert explains(localizer, one) == is_explained
