import numpy as np
import pytest
from scipy.stats import poisson

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.appearance.features import Features, features_of_image, features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex, log_tail
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import optical, sharp_room

CAMERA = Spherical(512, 256)
ROOMS = [sharp_room(seed=seed) for seed in range(5)]
HERE = SE3.exp([0.5, -0.4, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def index():
    made = AppearanceIndex()
    for number, room in enumerate(ROOMS):
        made.add(100 + number, features_of_sphere(room.sphere(HERE, CAMERA, number)))
    return made


@pytest.mark.parametrize("turn_deg", [90.0, -137.0])
def test_a_place_is_found_at_any_heading(index, turn_deg):
    there, number = HERE @ SE3.exp([0.3, 0.2, 0.0, 0.0, 0.0, np.radians(turn_deg)]), 3
    features = features_of_sphere(ROOMS[number].sphere(there, CAMERA, 50 + number))
    found = index.find(features, 3)
    assert found[0].sphere_id == 100 + number
    assert found[0].log_chance < -20 < found[1].log_chance
    others = [one.sphere_id for one in index.find(features, 9) if one.sphere_id != 103]
    assert [one.sphere_id for one in index.find(features, 9, without=[103])] == others


def test_an_ordinary_image_finds_its_sphere(index):
    lens = Pinhole(400, 300, 250.0, 250.0, 199.5, 149.5)
    found = 0
    for number, room in enumerate(ROOMS):
        there = HERE @ SE3.exp([0.1, 0.1, 0.0, 0.0, 0.0, 0.5 * number])
        image = features_of_image(room.photograph(lens, optical(there), number), lens)
        rays = (image.rays @ T_BODY_OPTICAL.rotation.T).astype(np.float32)
        alike = index.find(Features(rays, image.range_m, image.descriptors), 3)
        found += 100 + number in [one.sphere_id for one in alike]
    assert found >= 4  # of 5 rooms, in the first three: a view holds a sixth of a sphere


def test_key_spheres_that_come_one_by_one_are_found_as_those_that_come_at_once(index):
    growing, at_once, features = AppearanceIndex(), AppearanceIndex(), list(index.features.values())
    for number in range(8):
        growing.add(number, features[number % 5])
        assert growing.find(features[0], 1)[0].sphere_id % 5 == 0
        at_once.add(number, features[number % 5])
    assert growing.find(features[3], 8) == at_once.find(features[3], 8)


def test_the_chance_of_many_votes_is_the_tail_of_poisson():
    counts, means = (axis.ravel() for axis in np.meshgrid(np.arange(0, 300, 7), [1e-9, 0.2, 5.0, 80.0, 250.0]))
    expected = poisson.logsf(counts - 1, means)
    is_shown = expected > -600.0  # below, scipy's own ends
    np.testing.assert_allclose(log_tail(counts, means)[is_shown], expected[is_shown], rtol=1e-7, atol=1e-9)
    assert np.all(np.diff(log_tail(np.arange(300), np.full(300, 0.01))) < 0)  # none so small that two are alike
