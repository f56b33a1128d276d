"""A vehicle that learns by itself: drives that are kept, the new version that is judged, and the way back."""

import shutil
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from tf2_msgs.msg import TFMessage

import dense_localizer.key_images as key_images
from dense_localizer.params import LocalizerParams
from dense_localizer.references.rejections import Rejections
from dense_localizer.ros.drive_recorder import drives_of
from dense_localizer.ros.node import DenseLocalizerNode
from sphere_mapping.experiences.budget import Budget
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.ros.maps.check import verify_map
from sphere_nav.ros.maps.condensing import count_bytes
from sphere_nav.ros.maps.reader import MapDetails, open_map, save_map
from sphere_nav.spheres.condensed import condensed_sphere
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.lessons import learning, versions
from sphere_nav_tools.offline.lessons.examination import Marks, Placement, localize_key_images
from sphere_nav_tools.offline.lessons.kept_drives import find_drives
from sphere_nav_tools.offline.lessons.learning import find_lessons, learn_map, list_drives, take_back
from sphere_nav_tools.offline.lessons.teaching import Lesson, draw_range, make_sphere, teach
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, drive, make_map
from worlds.room import wide_room

START_NS = 1_000_000_000
NUM_IMAGES = 16
# The light of these lessons is one that local contrast would explain.
IN_GRAY = SMALL_IMAGES | {"alignment.contrast": False}
PARAMS = build(LocalizerParams, IN_GRAY | {"automatic": False})
SETTINGS = [word for name, value in IN_GRAY.items() for word in ("--set", f"{name}={value}")]
RAMP = np.linspace(0.4, 1.6, PINHOLE.width)  # a light from one side: placed 20 mm off, with a correlation of 0.77


def in_light(image):
    return np.clip(image * RAMP, 1, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def room():
    return wide_room()


@pytest.fixture(scope="module")
def pictures(room):
    return [room.photograph(PINHOLE, pose, k) for k, pose in enumerate(drive(NUM_IMAGES))]


def see(map_path, pictures, *, learn, start_ns=START_NS):
    """Localise a drive by the node; return what it published."""
    bus = OfflineBus()
    bus.add(DenseLocalizerNode, {"map": str(map_path), "learn": learn} | IN_GRAY)
    bus.publish("/tf_static", TFMessage(transforms=[se3_to_transform(SE3.identity(), start_ns, "base_link", "eye")]))
    bus.publish("/camera_info", camera_to_info(PINHOLE, start_ns, "eye"))
    said = []
    for k, picture in enumerate(pictures):
        stamp = start_ns + (k + 1) * STEP_NS
        said += bus.advance(stamp)
        bus.publish("/image_raw", array_to_image(picture, stamp, "eye", "mono8"))
        said += bus.settle()
    bus.close()
    return [one.message for one in said if one.topic in ("/pose", "/status")]


@pytest.fixture(scope="module")
def taught(room, pictures, tmp_path_factory):
    """A map with two drives beside it: one that it explained, and one in another light."""
    path = tmp_path_factory.mktemp("maps") / "room"
    sphere_map = make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0)])
    stamped = {node.id: replace(node.sphere, stamp_ns=node.stamp_ns) for node in sphere_map.graph}
    graph = sphere_map.graph.with_nodes({k: {"region_radius_m": 2.0, "sphere": one} for k, one in stamped.items()})
    save_map(path, graph, MapDetails("abc", source="first"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(key_images, "KEY_REACH", 0.01)  # of a room that is 3 m wide
        patch.setattr(key_images, "MAX_KEY_SIGMA_M", 0.1)  # uneven light makes a pose uncertain
        see(path, pictures, learn=True)
        see(path, [in_light(one) for one in pictures], learn=True, start_ns=100 * START_NS)
    return path


@pytest.fixture
def campus(taught, tmp_path):
    """A copy of it."""
    for folder in (taught, drives_of(taught)):
        shutil.copytree(folder, tmp_path / folder.name)
    return tmp_path / taught.name


def test_nothing_changes_under_a_vehicle_that_keeps_its_drive(taught, campus, pictures):
    before = (campus / "map.mcap").read_bytes()
    shutil.rmtree(drives_of(campus))
    said = [[str(one) for one in see(campus, pictures[:6], learn=learn)] for learn in (False, True)]
    pattern = "milliseconds"  # of computing
    strip = [[line[: line.index(pattern)] if pattern in line else line for line in one] for one in said]
    assert strip[0] == strip[1]
    assert (campus / "map.mcap").read_bytes() == before


def test_the_drives_are_found_and_the_bad_one_is_the_lesson(taught, pictures):
    drives = list_drives(taught)
    assert [one.name for one in drives] == ["19700101_000001", "19700101_000140"]
    assert [one.explanation.is_lesson for one in drives] == [False, True]
    assert find_lessons(taught, drives) == [drives[1]]
    images = list(drives[1].images())
    assert len(images) == drives[1].explanation.num_images
    assert all(one.image.shape == (120, 160) and one.camera == PINHOLE for one in images)
    assert np.array_equal(images[0].image, in_light(pictures[3]))  # after probation


def test_the_range_of_an_image_is_that_of_the_map(taught, room):
    image = next(iter(list_drives(taught)[1].images()))
    with open_map(taught) as base:
        sphere, T_map_sphere, covariance = make_sphere(base, image)
        drawn = draw_range(base, image)
    assert np.isfinite(drawn).mean() > 0.9
    true = room.sphere(T_map_sphere, sphere.camera, 0).range_m
    error = np.abs(sphere.range_m / true - 1.0)[sphere.measured]
    assert np.median(error) < 0.01  # 20 mm off, at 3 m
    assert sphere.measured.mean() > 0.5
    np.testing.assert_allclose(np.trace(covariance), np.trace(image.covariance))


def test_a_map_learns_a_light_and_forgets_it_again(campus, capsys):
    before = {file.name: file.read_bytes() for file in campus.iterdir()}
    with open_map(campus) as base:
        lesson = Lesson.of(list_drives(campus)[1], base.graph)
    assert len(lesson.taught) < len(lesson.withheld)
    assert main(["map-learn", str(campus), "--experience", "evening", *SETTINGS]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"{campus}: 1 of 1 drives learned"
    assert verify_map(campus) == []
    (version,) = versions.Versions(campus).earlier
    assert {file.name: file.read_bytes() for file in version.iterdir()} == before
    with open_map(version) as old, open_map(campus) as new:
        assert new.info.map_id == old.info.map_id == "abc"
        for node in old.graph:
            np.testing.assert_array_equal(node.T_map_sphere.matrix, new.graph[node.id].T_map_sphere.matrix)
        added = [node for node in new.graph if node.id not in old.graph.nodes]
        assert len(added) == len(lesson.taught)
        assert {node.experience.name for node in added} == {"evening"}
        assert {edge.b for edge in new.graph.edges} >= {node.id for node in added}
        marks = [localize_key_images(reader, lesson.withheld, PARAMS) for reader in (old, new)]
    assert [one.num_explained for one in marks] == [0, len(lesson.withheld)]
    assert main(["map-learn", str(campus), *SETTINGS]) == 1  # there is nothing left to learn
    assert main(["map-learn", str(campus), "--back"]) == 0
    assert {file.name: file.read_bytes() for file in campus.iterdir()} == before
    assert main(["map-learn", str(campus), *SETTINGS]) == 1  # what was taken back is not learned again
    with pytest.raises(BagError, match="expected a version before the present one, found none"):
        take_back(campus)


def test_a_version_that_makes_another_drive_worse_is_refused(campus, monkeypatch):
    before = (campus / "map.mcap").read_bytes()
    good, lost = Placement(0.01, 1.0, 0.001, 0.9), Marks((None,))
    marks = iter([lost, Marks((good,)), Marks((good,)), lost])
    monkeypatch.setattr(learning, "localize_key_images", lambda *_: next(marks))
    earlier = drives_of(campus) / "19700101_000140.refused"  # its name became free
    earlier.mkdir()
    (earlier / "kept").touch()
    (told,) = learn_map(campus, PARAMS)
    assert not told.is_taken
    assert told.told.endswith("19700101_000001: places 0 of 1 key images, before 1")
    assert (campus / "map.mcap").read_bytes() == before
    assert sorted(one.name for one in drives_of(campus).iterdir()) == [
        "19700101_000001",
        "19700101_000140-2.refused",
        "19700101_000140.refused",
    ]
    assert [one.name for one in earlier.iterdir()] == ["kept"]
    assert list(versions.Versions(campus).folder.iterdir()) == [versions.Versions(campus).folder / "lock"]


def test_a_version_that_explains_no_more_is_refused(campus, monkeypatch):
    same = Marks((Placement(0.01, 1.0, 0.001, 0.7),))
    monkeypatch.setattr(learning, "localize_key_images", lambda *_: same)
    (told,) = learn_map(campus, PARAMS)
    assert (told.is_taken, told.told) == (False, "explains 0 of 1 withheld images, before 0")


def test_rejections_and_a_budget_apply_to_the_new_version(taught, tmp_path):
    counts = np.zeros((2, 32, 64), np.int64)
    counts[:, 10:22] = 20
    counts[1, 12:15] = 0
    lesson = list_drives(taught)[1]
    with open_map(taught) as base:
        taught_images = Lesson.of(lesson, base.graph).taught[:1]
        number = teach(base, lesson, taught_images, tmp_path / "new", Rejections({0: counts}))
        assert number == 1
        teach(base, lesson, taught_images, tmp_path / "small", Rejections(), budget=Budget(1))
        with open_map(tmp_path / "new") as new:
            assert new.load_sphere(0).measured.mean() < base.load_sphere(0).measured.mean() - 0.05
            np.testing.assert_array_equal(new.load_sphere(1).range_m, base.load_sphere(1).range_m)
        with open_map(tmp_path / "new") as new:
            sizes = [[count_bytes(new, one, is_condensed) for one in new.graph.nodes] for is_condensed in (False, True)]
        savings = np.maximum(np.subtract(*sizes), 0.0)
        budget = Budget(num_bytes=new.num_bytes - 0.5 * savings.sum())
        teach(base, lesson, taught_images, tmp_path / "condensed", Rejections(), budget=budget)
    with open_map(tmp_path / "small") as small:
        assert len(small.graph) < 4
    with open_map(tmp_path / "condensed") as within, open_map(tmp_path / "new") as new:
        assert within.graph.nodes.keys() == new.graph.nodes.keys()
        spheres = [within.load_sphere(sphere_id) for sphere_id in within.graph.nodes]
        assert any(np.array_equal(condensed_sphere(one).range_m, one.range_m, equal_nan=True) for one in spheres)
        assert within.num_bytes <= budget.num_bytes
    for name in ("new", "small", "condensed"):
        assert verify_map(tmp_path / name) == []


def test_what_explains_how_much_of_a_lesson(taught, tmp_path):
    """New key spheres explain what the map did not; those of the map what they placed."""
    lesson = list_drives(taught)[1]
    with open_map(taught) as base:
        images = Lesson.of(lesson, base.graph).taught[:1]
        teach(base, lesson, images, tmp_path / "new", Rejections())
        served = Counter(one.references[0] for one in lesson.images() if one.is_explained)
        num_others = sum(not one.is_explained for one in lesson.images())
        assert num_others > 1
        with open_map(tmp_path / "new") as new:
            (added,) = new.graph.nodes.keys() - base.graph.nodes.keys()
            assert new.graph[added].served == num_others
            shares = sum(served.values()) / (sum(served.values()) + num_others)
            for node in base.graph:
                before = node.served if node.served or node.last_served_ns else num_others
                expected = before + 0.5 * (served[node.id] - shares * before)
                assert new.graph[node.id].served == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("moment", range(8))
def test_a_death_while_the_map_is_replaced_leaves_a_whole_one(tmp_path, monkeypatch, moment):
    """As if killed before the n-th change of a name; the next run mends what is left."""
    folders = [tmp_path / "map", tmp_path / "map.versions" / "next"]
    for folder, word in zip(folders, ("old", "new"), strict=True):
        folder.mkdir(parents=True)
        for name in ("map.mcap", "metadata.yaml"):
            (folder / name).write_text(f"{word} {name}")
    left, one = [moment], versions.Versions(tmp_path / "map")

    def dying(call):
        def step(*arguments, **values):
            if left[0] == 0:
                raise KeyboardInterrupt
            left[0] -= 1
            return call(*arguments, **values)

        return step

    with monkeypatch.context() as patch:
        patch.setattr(versions.os, "link", dying(versions.os.link))
        for name in ("mkdir", "rename", "replace", "rmdir"):
            patch.setattr(versions.Path, name, dying(getattr(versions.Path, name)))
        try:
            one.put_next()
            is_done = True
        except KeyboardInterrupt:
            is_done = False
    word = (tmp_path / "map" / "map.mcap").read_text().split()[0]
    assert word == ("new" if moment >= 5 else "old")
    assert is_done == (moment >= 7)
    with one.locked():
        texts = [(tmp_path / "map" / name).read_text() for name in ("map.mcap", "metadata.yaml")]
    assert texts == [f"{word} map.mcap", f"{word} metadata.yaml"]
    assert not one.next.exists()
    kept = [(version / "map.mcap").read_text() for version in one.earlier]
    assert kept == (["old map.mcap"] if word == "new" else [])


def test_only_one_process_makes_a_version(campus):
    with versions.Versions(campus).locked(), pytest.raises(BagError, match="another process makes a new version"):
        learn_map(campus, PARAMS)


def test_what_a_killed_drive_has_left_is_mended(campus, monkeypatch):
    drive_path = drives_of(campus) / "19700101_000140"
    torn = drive_path.with_name(drive_path.name + ".partial")
    drive_path.rename(torn)
    (torn / "metadata.yaml").unlink()
    with BagWriter(drives_of(campus) / "living") as living:
        found = find_drives(campus, "map")
        assert [one.name for one in found] == ["19700101_000001", "19700101_000140"]
        assert living.partial.exists()
        living.discard()
    assert found[1].explanation.is_lesson
    assert not torn.exists()


def test_a_damaged_drive_is_left_out(campus):
    (bag,) = (drives_of(campus) / "19700101_000001").glob("*.mcap")
    bag.write_bytes(bag.read_bytes()[:200])
    assert [one.name for one in list_drives(campus)] == ["19700101_000140"]


def test_the_drives_are_listed(campus, capsys):
    assert main(["map-learn", str(campus), "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("key images explained: explained")
    assert lines[1].endswith("key images explained: to be learned")
    assert lines[2] == f"{campus}: 2 drives, 1 to be learned"
