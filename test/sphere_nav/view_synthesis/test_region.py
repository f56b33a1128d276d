"""The region around a sphere: laws, and what bounds it."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.view_synthesis.region import region_radii, region_radius, usable_share
from sphere_nav.view_synthesis.surface import surface_of
from worlds.room import Room

CAMERA = Spherical(256, 128)


@pytest.fixture(scope="module")
def sphere(room):
    return room.sphere(SE3.identity(), CAMERA)


def test_at_the_sphere_all_is_usable_and_never_more_away_from_it(sphere):
    surface = surface_of(sphere)
    shares = [usable_share(surface, np.array([x, 0.0, 0.0])) for x in (0.0, 1.0, 2.0, 3.0, 3.8)]
    assert shares[0] > 0.9
    assert all(np.diff(shares) <= 0)
    assert shares[-1] < 0.3  # before a wall, 20 cm away


def test_twice_the_room_has_twice_the_region(sphere):
    larger = Room(half=(8.0, 6.0, 3.0)).sphere(SE3.identity(), CAMERA)
    assert region_radius(larger) == pytest.approx(2 * region_radius(sphere), rel=0.05)


def test_a_long_room_reaches_farther_along_than_across():
    radii = region_radii(Room(half=(20.0, 2.0, 1.5)).sphere(SE3.identity(), CAMERA))
    ahead, aside = radii[0], 0.5 * (radii[1] + radii[2])  # 0, 60 and 120 degrees
    assert ahead > 1.2 * aside
    assert ahead == pytest.approx(radii[3], rel=0.15)  # as far behind as ahead


def test_without_range_there_is_no_region(sphere):
    assert region_radius(replace(sphere, range_m=np.full_like(sphere.range_m, np.nan))) == 0.0
