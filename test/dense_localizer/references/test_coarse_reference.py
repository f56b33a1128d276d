"""What is kept of a key sphere, and which experience an image looks like by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from dense_localizer.references.coarse_reference import CoarseReferences, ExperienceChoice, Sight
from dense_localizer.references.reference import References
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import RegistrationParams, build_pyramid
from sphere_nav.spheres.graph import Experience, KeySphere
from sphere_nav.spheres.sphere import Sphere
from worlds.localizer import PINHOLE, SMALL_IMAGES, MemoryMap, at, make_map
from worlds.relit import EdgedRoom, relit
from worlds.room import Room

CAMERA, PARAMS = Spherical(128, 64), RegistrationParams()
FORWARD_STEP = 0.2


def sphere_of(range_m):
    gray = np.random.default_rng(0).uniform(0, 255, (CAMERA.height, CAMERA.width)).astype(np.uint8)
    return Sphere(gray, np.full(gray.shape, range_m, np.float32), CAMERA)


def test_the_median_range_tells_how_far_before_and_behind_a_camera_is_looked_for():
    references = CoarseReferences({0: sphere_of(4.0), 1: sphere_of(np.inf)}, PARAMS)
    near, bare = references[0], references[1]
    assert (near.typical_range_m, near.step_m) == (4.0, pytest.approx(FORWARD_STEP * 4.0))
    assert (bare.typical_range_m, bare.step_m) == (np.inf, 0.0)


def test_a_sphere_is_read_when_it_is_first_needed_and_made_again_when_so_many_others_were_made_since():
    read = []

    class Spheres(dict):
        def __missing__(self, sphere_id):
            read.append(sphere_id)
            return sphere_of(2.0 + sphere_id)

    references = CoarseReferences(Spheres(), PARAMS)
    assert references[1].typical_range_m == pytest.approx(3.0)
    first = references.reference(1)
    assert references.reference(1) is first
    for other in range(2, 2 + 32):
        assert set(read) == set(range(1, other))
        references.reference(other)
    assert references.reference(1) is not first


LOCALIZER = build(LocalizerParams, SMALL_IMAGES)
DAY, NIGHT, SNOW = Experience("day"), Experience("night"), Experience("snow")
WHOLE = Spherical(256, 128)
EDGES = (1.0, 6.0, 40)
ROOMS = {DAY: Room(seed=7), NIGHT: Room(seed=8), SNOW: Room(seed=9)}  # one geometry, other looks


def of_experience(experience, first_id, poses):
    nodes = make_map(ROOMS[experience], poses, WHOLE).graph
    return [replace(node, id=first_id + node.id, experience=experience, region_radius_m=3.0) for node in nodes]


@pytest.fixture(scope="module")
def days():
    """A map of three looks; the nights' key spheres are farther away."""
    poses = [SE3.from_planar(0.6 * k, 0.0, 0.0) for k in range(3)]
    far = [SE3.from_planar(0.6 * k + 0.2, 0.3, 0.0) for k in range(3)]
    return MemoryMap([*of_experience(DAY, 0, poses), *of_experience(NIGHT, 10, far), *of_experience(SNOW, 20, far)])


def sight(experience, x, is_followed=True):
    image = ROOMS[experience].photograph(PINHOLE, at(x), seed=3)
    return Sight(build_pyramid(image, PINHOLE).levels[-1], at(x), is_followed)


def test_references_are_of_the_experience_that_looks_like_the_image(days):
    references = References(days, LOCALIZER)
    for tens, experience in enumerate((DAY, NIGHT, SNOW)):
        chosen = references.choose(sight(experience, 0.25, is_followed=False), PINHOLE)
        assert [one // 10 for one in chosen.ids] == [tens, tens]


def test_in_a_light_that_is_in_none_edges_say_which_is_most_like_it():
    poses = [SE3.from_planar(0.6 * k, 0.0, 0.0) for k in range(3)]
    rooms = {DAY: EdgedRoom(seed=7, wave_numbers=EDGES), NIGHT: EdgedRoom(seed=8, wave_numbers=EDGES)}
    nodes = [
        replace(node, id=10 * k + node.id, experience=one, region_radius_m=3.0)
        for k, (one, room) in enumerate(rooms.items())
        for node in make_map(room, poses, WHOLE).graph
    ]
    references = References(MemoryMap(nodes), LOCALIZER)
    for k, room in enumerate(rooms.values()):
        image = relit(room.photograph(PINHOLE, at(0.25), 0), 0)
        seen = Sight(build_pyramid(image, PINHOLE).levels[-1], at(0.25), is_followed=False)
        assert references.choose(seen, PINHOLE).ids == (10 * k + 1, 10 * k + 2)  # ahead
    references.close()


class Scripted(ExperienceChoice):
    """A choice for which the likeness of each experience with the image is given."""

    def __init__(self):
        super().__init__(None)
        self.grays = {}

    def look(self, is_followed=True, instead_of=(), **likeness):
        """Return the choice, which explains the image."""
        self._likeness = {Experience(name): value for name, value in likeness.items()}
        reach = {one: replace(NODE, id=DRIVES.index(one.name), experience=one) for one in self._likeness}
        self.current = self.choose(reach, Sight(None, None, is_followed, instead_of))
        return self.current.name

    def compare_edges(self, node, sight):
        return self._likeness[node.experience]

    def compare(self, node, sight):
        return self.grays.get(node.experience.name, 0.5)


NODE = KeySphere(0, 0, SE3.identity())
DRIVES = ("day", "night", "snow")  # in their order


def test_what_is_in_use_stays_until_another_experience_explains_an_image():
    choice = Scripted()
    assert choice.look(is_followed=False, day=0.5, night=0.6) == "night"
    assert choice.look(day=0.9, night=0.1) == "night"
    choice.current = DAY
    assert choice.look(day=0.1, night=0.9) == "day"
    assert choice.look(night=0.1) == "night"  # no other within reach
    assert choice.look(is_followed=False, day=0.56, night=0.6) == "day"  # nearly alike: that of the first drive


def test_of_those_that_were_not_tried_the_one_in_use_serves_else_the_one_most_alike():
    choice, tried = Scripted(), {"day": 0.9, "night": 0.1, "snow": 0.5}
    choice.current = NIGHT
    assert choice.look(instead_of=(DAY,), **tried) == "night"
    assert choice.look(instead_of=(DAY, NIGHT), **tried) == "snow"
    choice.current = DAY
    assert choice.look(instead_of=(DAY,), **tried) == "snow"
    assert choice.look(is_followed=False, day=0.54, night=0.6) == "night"
    for lead, expected in ((0.04, "day"), (0.06, "night")):  # alike by edges: grey levels
        choice.grays = {"night": 0.5 + lead}
        assert choice.look(is_followed=False, day=0.6, night=0.6) == expected


def test_a_drive_starts_from_nowhere_in_any_experience(days):
    localizer = Localizer(LOCALIZER, days)
    for number in range(6):
        x = 0.2 + 0.03 * number
        estimate = localizer.update(
            ROOMS[SNOW].photograph(PINHOLE, at(x), seed=number), PINHOLE, 10**9 + number * 10**8
        )
    assert estimate.status.state == "TRACKING"
    assert estimate.T_map_camera.distance(at(x))[0] < 0.01
    assert set(estimate.status.references) <= {20, 21, 22}
    localizer.references.close()
