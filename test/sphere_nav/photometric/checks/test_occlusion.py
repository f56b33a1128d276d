"""A part of the view that does not show the map: that it is there, and by how much it biases a pose."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import find_occlusion_bias, find_rig_structure, keep_agreeing
from sphere_nav.photometric.pixels.samples import Sample
from worlds.room import BESIDE, soft_room, structure_of, views_of

OCCLUSION_SHARE = 0.1  # written out: imported, a change would go unseen

PARAMS = RegistrationParams(max_pixels=10_000, max_mad=100.0)
CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def soft():
    return soft_room(22)


@pytest.fixture(scope="module")
def views(soft):
    return views_of(soft, PARAMS)


def cover(image, share, seed):
    """Return an image whose left part shows something else."""
    width = int(share * image.shape[1])
    patch = np.kron(np.random.default_rng(seed).integers(0, 255, (8, 11)), np.ones((15, 15)))
    return np.hstack([patch[:, :width], image[:, width:]]).astype(np.uint8)


def seen(room, seed):
    image = cover(room.photograph(CAMERA, BESIDE, seed), 0.4, seed)
    return build_pyramid(image, CAMERA, PARAMS.pyramid)


def test_the_pose_by_what_is_free_is_found(soft, views):
    pyramid = seen(soft, 22)
    found = register(pyramid, views, BESIDE, PARAMS)
    off = found.T_world_camera.distance(BESIDE)[0]
    assert off > 0.15  # or there is nothing to find
    bias = structure_of(pyramid, views, found, PARAMS).occlusion
    assert bias.share >= OCCLUSION_SHARE
    assert (found.T_world_camera @ SE3.exp(bias.xi)).distance(BESIDE)[0] < min(0.1, 0.3 * off)


def gradients(angle, strength, at):
    """Return pixels at places of the image whose gradients are turned against those of the reference."""
    rng, ray = np.random.default_rng(3), np.column_stack([0.5 * at, np.ones(len(at))])
    first = rng.uniform(0.0, 2 * np.pi, len(at))
    rows = [strength[:, None] * np.column_stack([np.cos(a), np.sin(a), 0 * a]) for a in (first, first + angle)]
    length = np.linalg.norm(ray, axis=1, keepdims=True)
    zeros, view, by_point = np.zeros(len(at)), np.zeros(len(at), np.int64), np.zeros((len(at), 2, 3))
    return Sample(view, ray, length[:, 0], by_point, rows[0] / length, rows[1] / length, zeros, zeros, zeros, at)


def share_of(sample):
    return find_occlusion_bias(lambda _: sample, sample, SE3.identity()).share


def test_pixels_that_scatter_hide_nothing_and_as_many_that_agree_on_it_do():
    rng = np.random.default_rng(1)
    at = rng.uniform(-1.0, 1.0, (2048, 2))
    is_left = at[:, 0] < -0.2
    seen, other = rng.normal(0.0, 0.5, 2048), rng.uniform(-np.pi, np.pi, 2048)
    few = np.where(rng.uniform(size=2048) < 0.08, 20.0, 1.0)  # strong edges
    moved = is_left & (few > 1.0)  # seen from elsewhere
    assert share_of(gradients(np.where(is_left, other, seen), np.ones(2048), at)) > 0.3
    assert share_of(gradients(seen, few, at)) == 0.0
    assert share_of(gradients(np.where(moved, other, seen), few, at)) < OCCLUSION_SHARE


def test_what_hides_the_view_of_a_camera_pulls_its_body(soft, views):
    place = SE3.exp([0.2, -0.1, 0.3, 0.1, 0.4, -0.2])
    pyramid = seen(soft, 1)
    found = register(pyramid, views, BESIDE, PARAMS)
    _, alone = (structure_of(pyramid, views, found, PARAMS).occlusion for _ in range(2))
    body = replace(found, T_world_camera=found.T_world_camera @ place.inverse())
    there = find_rig_structure([RigImage(pyramid, place, tuple(views))], body, PARAMS).occlusion
    assert there.share == pytest.approx(alone.share, abs=1e-3)
    np.testing.assert_allclose(there.xi, (place @ SE3.exp(alone.xi) @ place.inverse()).log(), atol=1e-3)


# Each limit from both sides, by pixels whose cosines are known. 48 cells of 8 x 6 with 36 pixels each.
CELLS_U, CELLS_V = (x.ravel() for x in np.meshgrid((np.arange(48) + 0.5) / 24 - 1, (np.arange(36) + 0.5) / 18 - 1))
GRID = np.column_stack([CELLS_U, CELLS_V])
COLUMN, ROW = ((0.5 * (GRID + 1.0)) * (8, 6)).astype(int).T
CELL = ROW * 8 + COLUMN
SMALL_STEP = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.01])


def in_grid(cosine, where=None, step=SMALL_STEP):
    """Return pixels with such cosines, whose residuals are those of a step of the pose."""
    where = np.ones(len(GRID), bool) if where is None else where
    sample = gradients(np.arccos(np.broadcast_to(cosine, len(GRID))[where]), np.ones(where.sum()), GRID[where])
    return replace(sample, residual=-replace(sample, of_image=sample.of_reference).by_pose @ step)


def found_of(sample):
    """Return the share, whether a bias was looked for, and how often pixels were sampled anew."""
    calls = []
    found = find_occlusion_bias(lambda T: calls.append(T) or sample, sample, SE3.identity())
    return found.share, bool(found.xi.any()), len(calls)


def test_cells_are_eight_by_six():
    parts = (GRID[:, 0] < -1 + 4 / 24, 1 / 8), (GRID[:, 1] < -1 + 4 / 18, 1 / 6)  # two thirds of a cell spoil all of it
    for is_left, share in parts:
        assert found_of(in_grid(np.where(is_left, -1.0, 1.0)))[0] == pytest.approx(share)


def test_a_tenth_of_the_texture_is_an_occlusion_and_by_less_than_three_tenths_of_the_pixels_nothing_is_told():
    for cells, is_occluded in [(4, False), (5, True), (33, True), (34, False)]:
        share, is_biased, _ = found_of(in_grid(np.where(cells > CELL, 0.0, 1.0)))
        assert share == pytest.approx(cells / 48)
        assert is_biased == is_occluded


def test_the_best_quarter_of_the_cells_is_typical():
    for cells, share in [(35, 35 / 48), (37, 0.0)]:
        assert found_of(in_grid(np.where(cells > CELL, 0.0, 1.0)))[0] == pytest.approx(share)


def test_half_of_the_typical_cosine_agrees():
    for cosine, share in [(0.49, 0.25), (0.51, 0.0)]:
        assert found_of(in_grid(np.where(CELL < 12, cosine, 1.0)))[0] == pytest.approx(share)


def test_a_cell_is_occluded_where_its_mean_is_three_deviations_too_low():
    """36 pixels at m - s and m + s have a mean m of standard deviation s / 6."""
    for sigmas, share in [(2.9, 0.0), (3.1, 0.25)]:
        spread = np.where(np.arange(len(GRID)) % 2, 0.3, -0.3)
        cosine = np.where(CELL < 12, 0.5 - sigmas * 0.3 / 6 + spread, 1.0)
        assert found_of(in_grid(cosine))[0] == pytest.approx(share)


def test_a_cell_of_twelve_pixels_is_known():
    for number, share in [(11, 0.0), (12, 1.0)]:
        where = (CELL >= 12) | (np.cumsum(CELL == 0) <= number) & (CELL == 0)
        left = (CELL == 0)[where].sum()
        found = found_of(in_grid(np.where(CELL == 0, 0.0, 1.0), where))[0]
        assert left == number
        assert found == pytest.approx(share * number / where.sum())


def test_a_view_of_fifty_pixels_is_used():
    for number, is_used in [(49, False), (50, True)]:
        sample = in_grid(1.0, np.arange(len(GRID)) < number)
        _, kept = keep_agreeing(sample)
        assert bool(len(kept)) == is_used


def test_steps_end_when_the_image_moves_by_a_milliradian_and_after_six():
    for radians, calls in [(0.9e-3, 0), (1.2e-3, 6)]:
        step = np.array([0.0, 0.0, 0.0, radians, 0.0, 0.0])  # about x: points near the axis move by the angle
        assert found_of(in_grid(np.where(CELL < 12, 0.0, 1.0), step=step))[2] == calls
