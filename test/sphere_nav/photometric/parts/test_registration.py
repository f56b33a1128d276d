"""Cells vote for a motion; by it images of another day are aligned where grey levels lead away."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.constants import NUM_TRIED_MOTIONS
from sphere_nav.photometric.parts.kernels import score_shifts
from sphere_nav.photometric.parts.registration import (
    Shifts,
    agreeing,
    chance_of,
    fit_motion,
    motion_covariance,
    register_parts,
    vote,
)
from sphere_nav.photometric.pixels.samples import sample_images
from worlds.parked import CAMERA, SPHERE, TRUTH, other_day, parked
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
    for number, chance in [(9, 1.4e-3), (12, 3.1e-6), (14, 2.7e-8)]:
        found = chance_of(43, number)
        expected = sum(comb(40, k) * P_CHANCE**k * (1 - P_CHANCE) ** (40 - k) for k in range(number - 3, 41))
        assert found == pytest.approx(expected, rel=1e-9)
        assert found == pytest.approx(chance, rel=0.1)
    for number, num_agreeing in [(0, 0), (3, 3), (40, 0), (40, 3)]:
        assert chance_of(number, num_agreeing) == 1.0


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


XI = np.array([0.05, -0.1, 0.2, 0.004, 0.01, -0.02])
REACH = 8


def cells(rng, number, share):
    """Cells of a camera of 165 px: the first ones show the map, the others anything."""
    rays = np.stack([rng.uniform(-0.7, 0.7, number), rng.uniform(-0.5, 0.5, number), np.ones(number)], axis=-1)
    z = rng.uniform(2.0, 8.0, number)
    x, y = rays[:, 0], rays[:, 1]
    zero = np.zeros(number)
    by_u = np.stack([-1 / z, zero, x / z, x * y, -(1 + x**2), y], axis=-1)
    by_v = np.stack([zero, -1 / z, y / z, 1 + y**2, -x * y, -x], axis=-1)
    by_pose = 165.0 * np.stack([by_u, by_v], axis=1)
    shift = rng.integers(-REACH, REACH + 1, (number, 2)).astype(float)
    whole = round(share * number)
    shift[:whole] = by_pose[:whole] @ XI + rng.uniform(-0.5, 0.5, (whole, 2))
    return Shifts(shift, by_pose)


def test_a_third_that_agrees_is_found():
    found = cells(np.random.default_rng(0), 90, 0.33)
    xi = fit_motion(found)
    assert agreeing(found, xi[None])[0][:30].mean() > 0.9
    np.testing.assert_allclose(found.by_pose @ xi, found.by_pose @ XI, atol=1.0)  # px


def test_three_cells_say_nothing():
    for number in [0, 1, 3]:
        found = cells(np.random.default_rng(1), number, 1.0)
        assert fit_motion(found) is None
        assert np.isinf(np.diagonal(motion_covariance(found))).all()


def test_the_covariance_is_that_of_the_motion():
    rng, nees = np.random.default_rng(7), []
    for _ in range(200):
        found = cells(rng, 60, 1.0)
        xi = fit_motion(found)
        there = Shifts(found.shift - found.by_pose @ xi, found.by_pose)
        error = xi - XI
        nees.append(error @ np.linalg.solve(motion_covariance(there), error) / 6)
    assert 0.7 < np.mean(nees) < 1.1  # a shift errs by 0.29 px here, by 0.3 px at least is assumed


@pytest.mark.slow
def test_the_chance_of_the_best_of_all_motions_is_not_larger_than_told():
    rng, chances = np.random.default_rng(11), []
    for _ in range(400):
        found = cells(rng, 60, 0.0)
        xi = fit_motion(found)
        agree = 0 if xi is None else int(agreeing(found, xi[None]).sum())
        chances.append(min(chance_of(60, agree) * NUM_TRIED_MOTIONS, 1.0))
    assert np.mean(np.array(chances) <= 0.05) <= 0.05


FAR = TRUTH @ SE3.exp([0.15, 0.05, -0.25, 0.02, 0.06, -0.03])  # where the camera is thought to be


@pytest.fixture(scope="module")
def night():
    """Another day: other boxes, a light that falls off to one side, a part of the view of inverted contrast."""
    gray = other_day().photograph(CAMERA, TRUTH, 1).astype(np.float32)
    gray *= np.linspace(0.25, 1.0, CAMERA.width)[None, :]
    gray[:, 90:125] = gray[:, 90:125].max() - gray[:, 90:125]
    return build_pyramid(np.clip(gray, 1, 255).astype(np.uint8), CAMERA, PARAMS.pyramid)


def off(pose):
    return pose.distance(TRUTH)


def test_another_day_is_aligned_by_its_parts_where_grey_levels_lead_away(night, view):
    by_levels = register(night, [view], FAR, PARAMS)
    assert off(by_levels.T_world_camera)[0] > 0.1
    found = register_parts([RigImage(night, views=(view,))], FAR, PARAMS)
    assert found.chance < 1e-7
    assert off(found.T_world_body)[0] < 0.02
    assert off(found.T_world_body)[1] < 0.005
    xi = (found.T_world_body.inverse() @ TRUTH).log()
    assert xi @ np.linalg.solve(found.covariance, xi) < 22.5  # chi^2 of 6 at 0.001


def test_a_camera_on_a_body_gives_the_pose_of_the_body(night, view):
    mount = SE3.exp([0.4, -0.2, 0.1, 0.3, -0.1, 0.7])
    found = register_parts([RigImage(night, mount, (view,))], FAR @ mount.inverse(), PARAMS)
    assert off(found.T_world_body @ mount)[0] < 0.02
