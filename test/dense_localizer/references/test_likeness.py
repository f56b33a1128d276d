"""Of several experiences the one that looks like the image is chosen, at the cost of one more comparison."""

from dataclasses import replace

import pytest

from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from dense_localizer.references.likeness import ExperienceChoice, Sight
from dense_localizer.references.reference import References
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.spheres.graph import Experience
from worlds.localizer import PINHOLE, SMALL_IMAGES, MemoryMap, at, make_map
from worlds.room import Room

PARAMS = build(LocalizerParams, SMALL_IMAGES)
DAY, NIGHT, SNOW = Experience("day"), Experience("night"), Experience("snow")
WHOLE = Spherical(256, 128)
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
    references = References(days, PARAMS)
    for experience, ids in ((DAY, (0, 1)), (NIGHT, (10, 11)), (SNOW, (20, 21))):
        chosen = references.choose(at(0.25), PINHOLE, sight=sight(experience, 0.25, is_followed=False))
        assert chosen.ids == ids
    assert references.choose(at(0.25), PINHOLE).ids[0] in (0, 10, 20)  # without an image by distance alone


def test_followed_images_cost_two_comparisons_and_change_over(days, monkeypatch):
    references = References(days, PARAMS)
    asked = []
    compare = ExperienceChoice.compare
    monkeypatch.setattr(
        ExperienceChoice, "compare", lambda self, node, seen: asked.append(node) or compare(self, node, seen)
    )
    references.choose(at(0.1), PINHOLE, sight=sight(DAY, 0.1, is_followed=False))
    assert len(asked) == 3  # nothing is known: all
    used = []
    for _ in range(10):
        asked.clear()
        used.append(references.choose(at(0.1), PINHOLE, sight=sight(NIGHT, 0.1)).ids[0])
        assert len(asked) == 2
    assert used[0] == 0  # one image is not enough
    assert used[-1] == 10


def test_what_is_out_of_reach_is_not_chosen(days):
    far_night = [replace(node, region_radius_m=0.1) if node.experience == NIGHT else node for node in days.graph]
    references = References(MemoryMap(far_night), PARAMS)
    assert references.choose(at(0.25), PINHOLE, sight=sight(NIGHT, 0.25, is_followed=False)).ids[0] not in (10, 11, 12)


def test_one_experience_is_never_compared(days, monkeypatch):
    monkeypatch.setattr(ExperienceChoice, "compare", lambda *_: pytest.fail("compared"))
    alone = References(MemoryMap([node for node in days.graph if node.experience == DAY]), PARAMS)
    assert alone.choose(at(0.25), PINHOLE, sight=sight(DAY, 0.25)).ids == (0, 1)


@pytest.mark.parametrize("experience", [DAY, SNOW])
def test_a_drive_starts_from_nowhere_in_any_experience(days, experience):
    localizer = Localizer(PARAMS, days)
    for number in range(6):
        x = 0.2 + 0.03 * number
        estimate = localizer.update(
            ROOMS[experience].photograph(PINHOLE, at(x), seed=number), PINHOLE, 10**9 + number * 10**8
        )
    assert estimate.status.state == "TRACKING"
    assert estimate.T_map_camera.distance(at(x))[0] < 0.01
    assert set(estimate.status.references) <= ({0, 1, 2} if experience is DAY else {20, 21, 22})
    localizer.references.close()
