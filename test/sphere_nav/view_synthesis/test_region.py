"""The region around a sphere: laws, and what bounds it."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.region import region_radius, usable_share
from sphere_nav.view_synthesis.surface import surface_of
from worlds.room import Room

CAMERA = Spherical(256, 128)


@pytest.fixture(scope="module")
def sphere(room):
    return room.sphere(SE3.identity(), CAMERA)


def test_at_the_sphere_all_is_usable_never_more_away_from_it_and_less_before_a_wall(sphere, room):
    surface = surface_of(sphere)
    shares = [usable_share(surface, np.array([x, 0.0, 0.0])) for x in (0.0, 1.0, 2.0, 3.0, 3.8)]
    assert shares[0] > 0.9
    assert all(np.diff(shares) <= 0)
    assert shares[-1] < 0.3  # before a wall, 20 cm away
    surface = surface_of(room.sphere(SE3.from_planar(2.0, 0.0, 0.0), CAMERA))
    before, behind = (usable_share(surface, np.array([x, 0.0, 0.0])) for x in (1.5, -1.5))
    assert before < 0.8 * behind


def test_what_is_farther_than_300_m_tells_no_place():
    for range_m, share in [(290.0, 1.0), (310.0, 0.0)]:
        assert usable_share(surface_of(ball(range_m)), np.zeros(3)) == pytest.approx(share, abs=0.01)


def test_twice_the_room_has_twice_the_region_and_without_range_there_is_none(sphere):
    larger = Room(half=(8.0, 6.0, 3.0)).sphere(SE3.identity(), CAMERA)
    assert region_radius(larger) == pytest.approx(2 * region_radius(sphere), rel=0.05)
    assert region_radius(replace(sphere, range_m=np.full_like(sphere.range_m, np.nan))) == 0.0


def ball(range_m):
    """A sphere that saw the same range everywhere."""
    shape = (CAMERA.height, CAMERA.width)
    return Sphere(np.full(shape, 90, np.uint8), np.full(shape, range_m, np.float32), CAMERA)


def share_in_a_ball(shift):
    """The share that is usable inside a ball of radius 1, in closed form: 40 degrees up and down, ratios below 2.

    A ray e from p meets the ball after t at n = p + t e. A small turn of e moves n by t (I - e n' / (n . e)): by t
    across the plane of e and p, by t / (n . e) within.
    """
    elevation, azimuth = np.meshgrid(np.radians(np.linspace(-36, 36, 400)), np.linspace(0, 2 * np.pi, 720)[:-1])
    e = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)
    along = e @ shift
    t = -along + np.sqrt(along**2 + 1 - shift @ shift)
    cosine = np.sum((shift + t[..., None] * e) * e, axis=-1)
    across, within = t, t / cosine
    is_alike = (np.maximum(across, within) < 2) & (np.minimum(across, within) > 0.5)
    return float(np.sum(np.cos(elevation) * is_alike) / np.sum(np.cos(elevation)))


def test_within_a_ball_the_usable_share_is_the_one_in_closed_form():
    for shift in [(0.6, 0.0, 0.0), (0.5, 0.5, 0.2)]:
        found = usable_share(surface_of(ball(5.0)), 5.0 * np.array(shift))
        assert found == pytest.approx(share_in_a_ball(np.array(shift)), abs=0.03)


def test_the_radius_is_where_a_fifth_is_left():
    def kept(radius):
        return share_in_a_ball(np.array([radius, 0.0, 0.0])) / share_in_a_ball(np.zeros(3))

    assert kept(0.99) > 0.2  # a ball has no end inside it
    corridor = Room(half=(30.0, 2.0, 1.5)).sphere(SE3.identity(), CAMERA)
    surface, radius = surface_of(corridor), region_radius(corridor)
    whole, angles = usable_share(surface, np.zeros(3)), np.arange(6) * np.pi / 3
    ways = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    near, far = (sum(usable_share(surface, by * radius * way) > 0.2 * whole for way in ways) for by in (0.95, 1.3))
    assert near >= 4 > 2 >= far  # a median: along the corridor it reaches farther
