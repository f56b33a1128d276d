"""Cells of a view: how far each is shifted, which agree, and the chance of as many in a wrong place."""

from math import comb

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams, build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.parts.kernels import score_shifts
from sphere_nav.photometric.parts.votes import chance_of, vote
from sphere_nav.photometric.pixels.samples import sample_images
from worlds.parked import CAMERA, SPHERE, TRUTH, parked
from worlds.room import views_of

PARAMS = RegistrationParams(max_pixels=20_000)
P_CHANCE = 9 / 289  # nine of 17 x 17 shifts are within a pixel of none


@pytest.fixture(scope="module")
def room():
    return parked()


@pytest.fixture(scope="module")
def view(room):
    return views_of(room, PARAMS, SPHERE, [SE3.from_planar(-2.0, 0.0, 0.0)])[0]


@pytest.fixture(scope="module")
def image(room):
    return build_pyramid(room.photograph(CAMERA, TRUTH, 1), CAMERA, PARAMS.pyramid)


def looked(image, view, T_world_body, T_body_camera=None):
    images = [RigImage(image, T_body_camera, (view,))]
    return images, sample_images(images, T_world_body, np.array([[1.0, 0.0]]), PARAMS)


@pytest.mark.parametrize("xi", [(0, 0, 0, 0.02, 0.0, 0), (0.1, 0, 0, 0, 0, 0), (0, 0, 0.15, 0, 0, 0)])
def test_cells_are_shifted_as_the_motion_that_is_missing_shifts_them(image, view, xi):
    mount = SE3.exp([0.3, -0.2, 0.1, 0.2, -0.3, 0.5])
    images, sample = looked(image, view, TRUTH @ mount.inverse() @ SE3.exp(np.array(xi)).inverse(), mount)
    found = vote(images, PARAMS, sample).shifts
    expected = found.by_pose @ np.array(xi)
    assert np.abs(expected).max() > 2.0  # px, or nothing has moved
    near = np.abs(found.shift - expected).max(axis=1) <= 1.5
    assert near[np.abs(expected).max(axis=1) < 7.0].mean() > 0.75


def test_pixels_of_agreeing_cells_are_kept_each_with_its_cell(image, view):
    images, _ = looked(image, view, TRUTH)
    sample = sample_images(2 * images, TRUTH, np.array([[1.0, 0.0], [1.0, 0.0]]), PARAMS)
    votes = vote(2 * images, PARAMS, sample)  # a cell of one camera is none of the other
    assert len(votes.kept) == len(votes.owner)
    assert len(np.unique(votes.owner)) == votes.agrees.sum() == 2 * votes.agrees[:96].sum() > 0


def test_what_may_leave_the_image_when_it_is_shifted_does_not_vote(image, view):
    images, sample = looked(image, view, TRUTH)
    middle, half = np.array([119.5, 89.5]), np.array([119.5, 89.5]) - 8.6  # px; 8 either way, and a neighbour
    at_edge = np.flatnonzero((np.abs(CAMERA.project(sample.points)[0] - middle) > half).any(axis=1))
    assert not vote(images, PARAMS, sample.where(np.tile(at_edge, 5))).is_known.any()  # of pixels enough


def test_a_view_has_twelve_columns_and_eight_rows_and_twelve_pixels_make_a_cell_known(image, view):
    images, sample = looked(image, view, TRUTH)

    def cells_of(columns, rows, most=10_000):
        u, v = np.rint(CAMERA.project(sample.points)[0]).T
        chosen = np.flatnonzero((u >= columns[0]) & (u < columns[1]) & (v >= rows[0]) & (v < rows[1]))[:most]
        return vote(images, PARAMS, sample.where(chosen)).is_known.sum()

    assert cells_of((80, 120), (68, 113)) == 4  # 20 px wide and 22.5 high
    assert [cells_of((80, 100), (68, 90), most) for most in (11, 12)] == [0, 1]


def test_the_chance_is_binomial_but_for_what_six_numbers_fit_which_says_nothing():
    for agreeing, chance in [(9, 1.4e-3), (12, 3.1e-6), (14, 2.7e-8)]:
        found = chance_of(43, agreeing)
        expected = sum(comb(40, k) * P_CHANCE**k * (1 - P_CHANCE) ** (40 - k) for k in range(agreeing - 3, 41))
        assert found == pytest.approx(expected, rel=1e-9)
        assert found == pytest.approx(chance, rel=0.1)
    for number, agreeing in [(0, 0), (3, 3), (40, 0), (40, 3)]:
        assert chance_of(number, agreeing) == 1.0


def test_a_score_is_the_weighted_sum_of_cosines_of_its_cell_at_each_shift(rng):
    image, reach = rng.integers(0, 255, (30, 40)).astype(np.float32), 2
    image[10, 10] = np.nan  # not seen
    column, row = rng.integers(3, 37, 50).astype(np.int32), rng.integers(3, 27, 50).astype(np.int32)
    angle, weight = rng.uniform(-np.pi, np.pi, 50), rng.uniform(1.0, 2.0, 50).astype(np.float32)
    direction = np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    cell = rng.integers(0, 3, 50)
    scores = np.zeros((3, 5, 5))
    score_shifts(image, column, row, direction, weight, cell, reach, scores)
    down, right = np.gradient(image)
    expected = np.zeros((3, 5, 5))
    for i, j in np.ndindex(5, 5):
        y, x = row + i - reach, column + j - reach
        gradient = np.column_stack([right[y, x], down[y, x]])
        cosine = np.sum(gradient * direction, axis=1) / np.linalg.norm(gradient, axis=1)
        np.add.at(expected[:, i, j], cell, np.nan_to_num(weight * cosine))
    np.testing.assert_allclose(scores, expected, atol=1e-4)
