"""Disparity along columns: near surfaces by coarser levels, and nothing where nothing can be known."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range import matching
from sphere_mapping.acquisition.range.matching import Search, match_columns

SHAPE = (512, 400)
NOISE = 1.5


def texture(seed, blur=1.5, contrast=40):
    image = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, SHAPE), (0, 0), blur)
    return 128 + contrast * image / image.std()


def match(top, bottom, last_px=150.0, **params):
    rng = np.random.default_rng(9)
    read = [np.clip(image + rng.normal(0, NOISE, SHAPE), 1, 255).astype(np.uint8) for image in (top, bottom)]
    return match_columns(*read, Search(-2.0, last_px), MatchParams(**params), np.ones(SHAPE, np.bool_))


@pytest.mark.parametrize("shift", [0, 10, 44, 70, 140])
def test_every_disparity_of_the_search_is_found_whichever_level_it_needs(shift):
    top = texture(0, blur=4.0)
    found = match(top, np.roll(top, -shift, axis=0))
    inner = found.value[200:-30, 30:-30]
    known = np.isfinite(inner)
    assert known.mean() > 0.5
    assert np.abs(inner[known] - shift).max() < 0.5


def test_a_window_is_matched_as_coarsely_as_its_whole_sphere(monkeypatch):
    sizes, find = [], matching.match_semi_globally

    def note(top, *values, **options):
        sizes.append(top.shape)
        return find(top, *values, **options)

    monkeypatch.setattr(matching, "match_semi_globally", note)
    top = np.clip(texture(0, blur=4.0), 1, 255).astype(np.uint8)
    search = Search(-2.0, 60.0, full_width=1.5 * matching.MAX_WIDTH)
    found = match_columns(top, np.roll(top, -20, axis=0), search, MatchParams(), np.ones(SHAPE, np.bool_)).value
    assert max(sizes) == (SHAPE[0] // 2, SHAPE[1] // 2)
    inner = found[100:-60, 30:-30]
    known = np.isfinite(inner)
    assert known.mean() > 0.5
    assert np.abs(inner[known] - 20).max() < 0.5  # refined at full size


def test_a_surface_nearer_than_the_search_is_not_measured():
    top = texture(0, blur=4.0)
    found = match(top, np.roll(top, -130, axis=0), last_px=40.0)
    assert np.isfinite(found.value).mean() < 0.01


def test_a_pattern_that_repeats_within_the_search_is_not_measured():
    rows = 128 + 50 * np.sin(2 * np.pi * np.arange(SHAPE[0]) / 16.0)
    stripes = np.repeat(rows[:, None], SHAPE[1], axis=1)
    found = match(stripes, np.roll(stripes, -8, axis=0))
    assert np.isfinite(found.value[64:]).mean() < 0.01  # above, the other matches would be outside of the image


def test_a_pattern_that_repeats_beyond_a_level_is_not_measured_by_it():
    top = np.tile(texture(1, blur=2.0)[:64], (8, 1))  # period 64 px: one minimum in the 48 disparities of a level
    found = match(top, np.roll(top, -60, axis=0))
    assert np.isfinite(found.value[150:-80, 30:-30]).mean() < 0.02


def test_texture_too_faint_for_a_fine_level_is_measured_by_a_coarser_one(monkeypatch):
    top = texture(5, blur=5.0, contrast=5)
    both = match(top, np.roll(top, -12, axis=0), noise=NOISE)
    monkeypatch.setattr(matching, "NUM_SCALES", 1)
    fine = match(top, np.roll(top, -12, axis=0), last_px=40.0, noise=NOISE)
    inner = np.s_[40:-30, 30:-30]
    shares = [np.isfinite(found.value[inner]).mean() for found in (fine, both)]
    assert shares[1] > shares[0] + 0.2
    known = np.isfinite(both.value[inner])
    error = np.abs(both.value[inner][known] - 12)
    assert np.mean(error > 3 * both.std[inner][known]) < 0.02


def test_a_pattern_that_is_clear_only_when_blurred_is_denied_by_the_finer_level():
    columns = np.broadcast_to(128 + 50 * np.sin(2 * np.pi * np.arange(SHAPE[0]) / 8.0)[:, None], SHAPE)
    blurred = texture(6, blur=12.0, contrast=6)
    found = match(columns + blurred, columns + np.roll(blurred, -12, axis=0))  # 12 is no multiple of 8
    assert np.isfinite(found.value[64:]).mean() < 0.02


def test_bare_walls_and_independent_noise_are_not_measured():
    bare = np.full(SHAPE, 120.0)
    assert np.isfinite(match(bare, bare).value).mean() < 0.01
    for blur in (0.5, 1.5):
        found = match(texture(1, blur), texture(2, blur))
        assert np.isfinite(found.value).mean() < 0.01


def test_a_bare_panel_does_not_get_the_range_of_the_wall_around(monkeypatch):
    wall = texture(7, blur=3.0)
    images = [wall.copy(), np.roll(wall, -12, axis=0)]
    for image in images:
        image[:, 200:216] = 60.0  # at any range: along the columns nothing tells
    panel, inner = np.s_[60:-60, 204:212], np.s_[60:-60, 240:380]
    assert np.isfinite(match(*images).value[panel]).mean() > 0.8  # matched at full size: noise is too much there
    monkeypatch.setattr(matching, "MAX_WIDTH", SHAPE[1] // 2)
    found = match(*images)
    assert np.isfinite(found.value[panel]).mean() < 0.1
    np.testing.assert_array_equal(np.isnan(found.std), np.isnan(found.value))
    known = np.isfinite(found.value[inner])
    assert known.mean() > 0.8
    assert np.abs(found.value[inner][known] - 12).max() < 0.5


def test_errors_by_their_deviation_are_of_size_one():
    top = texture(3, contrast=25)
    found = match(top, np.roll(top, -12, axis=0), noise=NOISE, calibration_px=0.0)
    known = np.isfinite(found.value)
    ratio = (found.value[known] - 12) / found.std[known]
    # smoothing makes it better than one block says; the factor on it is that of rooms, where more than noise errs
    assert 0.2 < np.sqrt(np.mean(ratio[np.abs(ratio) < 5] ** 2)) < 1.2
    assert np.mean(np.abs(ratio) > 3) < 0.01


@pytest.mark.parametrize(
    ("sides", "last_px", "halvings", "found"),
    [
        ((512, 600), 40.0, 0, [512, 256, 128]),  # three levels are matched at least
        ((600, 256), 40.0, 0, [256, 128, 64]),
        ((600, 255), 40.0, 0, [255, 127]),  # but none of less than 64 px
        ((512, 600), 40.0, 1, [512, 256, 128, 64]),  # the first is not matched
        ((512, 600), 45.0, 0, [512, 256, 128]),  # of 48 disparities from -2 on the last is 45
        ((1024, 999), 185.0, 0, [999, 499, 249, 124]),  # at a quarter it would be 46.25
        ((1024, 999), 184.0, 0, [999, 499, 249]),
        ((200, 200), 400.0, 0, [200, 100]),  # too small to reach them all
    ],
)
def test_images_are_halved_until_all_disparities_are_reached(sides, last_px, halvings, found):
    image = np.zeros(sides, np.uint8)
    levels = matching._levels_of(image, image, Search(-2.0, last_px), halvings)
    assert [min(top.shape) for top, _ in levels] == found
    assert all(top.shape == bottom.shape for top, bottom in levels)


def test_what_is_nearer_than_a_level_sees_is_that_of_the_coarser_one(monkeypatch):
    """Of 48 disparities from -2 on, the last three, 43 to 45, are left to the coarser level, too."""
    coarse = np.array([[20.0, 21.0, 21.125, 24.0]], np.float32)
    planes = {(2, 8): np.full((2, 8), 5.0, np.float32), (1, 4): coarse}
    monkeypatch.setattr(matching, "match_semi_globally", lambda top, *_, **__: planes[top.shape].copy())
    monkeypatch.setattr(
        matching, "compare_costs", lambda top, _, seen, *__, **___: [np.full(top.shape, 9.0) for _ in seen]
    )
    levels = [(np.zeros(shape, np.uint8),) * 2 for shape in planes]
    matches = matching._Matches(levels, Search(-2.0, 60.0), 0, 1)
    matches.check_level(1, None)
    found, _ = matches.check_level(0, None)
    np.testing.assert_array_equal(found, np.repeat([[5.0, 5.0, 42.25, 48.0]], 2, axis=0).repeat(2, axis=1))
