"""Headings by edges: right in another light, beside the middle of the sphere, for tilted cameras and windows."""

from functools import cache

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.spheres.appearance.headings import GRID, TURN_RAD, cut_view, draw_sphere, rank_headings, score_headings
from sphere_nav.spheres.appearance.kernels import score_turns
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.relit import EdgedRoom, relit

ROOM = EdgedRoom(wave_numbers=(1.0, 6.0, 40))
PINHOLE = Pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)
FISHEYE = Fisheye(320, 240, 120.0, 120.0, 159.5, 119.5, (0.02, -0.01, 0.0, 0.0))
WHOLE = Spherical(512, 256)


def turned(yaw, place=(0.0, 0.0, 0.0), T_level_camera=T_BODY_OPTICAL):
    return SE3.from_parts(SE3.from_planar(0, 0, yaw).rotation, place) @ T_level_camera


@cache
def panorama(sphere=WHOLE):
    return draw_sphere(coarse_sphere(ROOM.sphere(SE3.identity(), sphere)))


@pytest.fixture(scope="module", autouse=True)
def _drawn():
    """What all tests ask is drawn, and what they compute with is loaded, once, and charged to none of them."""
    likeliest(ROOM.photograph(FISHEYE, turned(0.0)), FISHEYE)


def likeliest(image, camera, T_level_camera=T_BODY_OPTICAL, sphere=WHOLE, count=1):
    return rank_headings(cut_view(image, camera, T_level_camera), panorama(sphere), count)


def off(heading, yaw):
    return abs((heading.yaw - yaw + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.parametrize("yaw", [1.3, -2.9])
def test_a_turned_camera_finds_its_heading_in_another_light(yaw):
    image = ROOM.photograph(FISHEYE, turned(yaw, (0.3, 0.1, 0.05)))
    assert off(likeliest(relit(image, 1), FISHEYE)[0], yaw) < 0.15


def test_a_camera_beside_the_middle_of_the_sphere_finds_its_heading():
    yaw = 2.0
    beside = turned(yaw, (0.5 * np.sin(yaw), -0.5 * np.cos(yaw), 0.1))  # to the right: all cells are shifted
    view = cut_view(ROOM.photograph(PINHOLE, beside), PINHOLE, T_BODY_OPTICAL)
    (found,) = rank_headings(view, panorama(), 1)
    assert off(found, yaw) < 0.15
    assert found.score > 0.46  # 0.4 where no cell may lie beside its place


def test_a_narrow_camera_finds_its_heading_within_the_reach_of_its_cells():
    camera, yaws = Pinhole(320, 240, 600.0, 600.0, 159.5, 119.5), (0.1, 0.8, -1.2)
    found = (likeliest(ROOM.photograph(camera, turned(yaw)), camera)[0] for yaw in yaws)
    assert max(off(one, yaw) for one, yaw in zip(found, yaws, strict=True)) < 0.05  # 0.10: anywhere within it


@pytest.mark.parametrize(("roll", "pitch"), [(0.6, 0.0), (0.0, 0.5)])
def test_a_tilted_camera_is_drawn_upright(roll, pitch):
    T_level_camera = SE3.from_angles(roll, pitch, 0.0, np.zeros(3)) @ T_BODY_OPTICAL
    image = ROOM.photograph(PINHOLE, turned(0.8, T_level_camera=T_level_camera))
    right, wrong = (likeliest(image, PINHOLE, T)[0] for T in (T_level_camera, T_BODY_OPTICAL))
    assert off(right, 0.8) < 0.1
    assert right.score > wrong.score + 0.1


def test_a_window_of_a_sphere_is_found_where_it_looks():
    window = Spherical(200, 128, 512.0, 20.0, 64.0)
    yaw = float(np.pi - (20.0 + 100.0) * 2 * np.pi / 512)
    assert off(likeliest(ROOM.photograph(PINHOLE, turned(yaw)), PINHOLE, sphere=window)[0], yaw) < 0.1


def test_headings_of_one_sphere_are_apart_and_the_likeliest_is_first():
    found = likeliest(ROOM.photograph(PINHOLE, turned(0.5)), PINHOLE, count=4)
    assert len(found) == 4
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)
    gaps = [off(a, b.yaw) for k, a in enumerate(found) for b in found[:k]]
    assert min(gaps) > 10 * TURN_RAD
    assert found[0].score > found[1].score + 0.1


def test_the_strongest_half_of_the_edges_is_compared_and_nothing_that_no_camera_saw():
    image = ROOM.photograph(PINHOLE, turned(0.5)).astype(np.float32)
    v, u = np.indices((GRID.height, GRID.width))
    _, is_seen = PINHOLE.project(GRID.unproject(np.stack([u, v], axis=-1)) @ T_BODY_OPTICAL.rotation)
    whole = cut_view(image, PINHOLE, T_BODY_OPTICAL)
    assert 0.4 < len(whole.row) / np.count_nonzero(is_seen) < 0.5  # cells with few of them are left out
    assert np.mean(np.linalg.norm(whole.direction, axis=1)) > 0.7  # 0.48 of all, 0.19 of the others
    image[:, 160:] = np.nan
    half = cut_view(image, PINHOLE, T_BODY_OPTICAL)
    blank = cut_view(np.full_like(image, 90.0), PINHOLE, T_BODY_OPTICAL)
    assert (rank_headings(blank, panorama(), 1), score_headings(blank, panorama()).max()) == ([], -np.inf)
    assert 0 < len(half.norm) < 0.7 * len(whole.norm)
    assert np.all(np.isfinite(half.direction))


def test_a_score_is_the_sum_of_products_of_its_cell_at_each_turn_and_rise(rng):
    height, width, number, reach = 7, 12, 40, 2
    directions = rng.normal(size=(2, height, width)).astype(np.float32)
    row, column = rng.integers(0, height, number), rng.integers(0, width, number)
    direction, cell = rng.normal(size=(number, 2)).astype(np.float32), rng.integers(0, 3, number)
    scores = np.zeros((3, 2 * reach + 1, width), np.float32)
    places = row.astype(np.int32), column.astype(np.int32)
    score_turns(*places, direction, cell.astype(np.int32), reach, directions, scores)
    expected = np.zeros(scores.shape)
    for rise in range(-reach, reach + 1):
        for turn in range(width):
            y = row + rise
            there = directions[:, y.clip(0, height - 1), (column + turn) % width] * ((y >= 0) & (y < height))
            np.add.at(expected[:, rise + reach, turn], cell, np.sum(there.T * direction, axis=1))
    np.testing.assert_allclose(scores, expected, atol=1e-4)
