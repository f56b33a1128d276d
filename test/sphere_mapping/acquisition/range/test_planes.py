"""A room of flat bare walls and a rough floor, in closed form: bare walls have the range of their outlines' plane."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.kernels import match_outline
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges
from sphere_mapping.acquisition.range.planes import Viewpoints, _fit, range_of_planes
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid

WHOLE, BASELINE_M, FINER = Spherical(512, 256), 0.3, 3
LOW, HIGH = np.array([-2.0, -2.6, -1.4]), np.array([3.0, 2.2, 1.3])  # m, of the room around the upper centre
BOX = (np.array([1.6, -0.7, -1.4]), np.array([2.2, 0.6, 0.1]))  # a bare box that stands before a wall
LEVELS = {0: 90.0, 1: 125.0, 2: 150.0, 3: 170.0, 4: 60.0, 5: 205.0}  # of the walls by axis and side


def see(height_m, rng, box):
    """Return image and range (H, W) of the room from so far above the upper centre."""
    fine = Spherical(FINER * WHOLE.width, FINER * WHOLE.height)
    rays, center = fine.unproject(pixel_grid(fine)), np.array([0.0, 0.0, height_m])
    with np.errstate(divide="ignore"):
        ways = np.where(rays > 0, HIGH - center, LOW - center) / rays
    axis = np.argmin(ways, axis=-1)
    range_m = np.min(ways, axis=-1)
    face = 2 * axis + np.take_along_axis(rays > 0, axis[..., None], -1)[..., 0]
    levels = np.vectorize(LEVELS.get)(face)
    points = center + rays * range_m[..., None]
    grain = cv2.GaussianBlur(np.random.default_rng(7).normal(0, 1, (600, 600)).astype(np.float32), (0, 0), 1.5)
    grain *= 40 / grain.std()
    on_floor = face == 4
    u, v = ((points[..., k] * 60 + 200).astype(np.float32) for k in (0, 1))
    levels = np.where(on_floor, 90 + cv2.remap(grain, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), levels)
    if box:
        first, last = ((side - center) / rays for side in BOX)
        near, far = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
        is_hit = (near < far) & (near > 0) & (near < range_m)
        levels, range_m = np.where(is_hit, 35.0, levels), np.where(is_hit, near, range_m)
    image = cv2.resize(levels, (WHOLE.width, WHOLE.height), interpolation=cv2.INTER_AREA)
    image = np.clip(np.rint(image + rng.normal(0, 1.0, image.shape)), 1, 255).astype(np.uint8)
    middle = FINER // 2
    return image, range_m[middle::FINER, middle::FINER]


def one_viewpoint():
    """Return the viewpoints of two spheres that were taken from one centre each."""
    shape = (WHOLE.height, WHOLE.width)
    centers = np.zeros((1, 3), np.float32)
    return Viewpoints(
        BASELINE_M, np.zeros(shape, np.int8), centers, np.zeros(shape, np.float32), np.ones(shape, np.float32), 0.0
    )


def fill(*, box):
    """Return range, its deviation and the truth (H, W); nothing is measured before."""
    rng, params = np.random.default_rng(3), MatchParams()
    (top, truth), (bottom, _) = see(0.0, rng, box), see(-BASELINE_M, rng, box)
    nothing = np.full(top.shape, np.nan, np.float32)
    everywhere, search = np.ones(top.shape, np.bool_), disparities_of_ranges(WHOLE, BASELINE_M, params)
    places = one_viewpoint()
    return *range_of_planes(top, bottom, (nothing, nothing), everywhere, places, search, params), truth


@pytest.fixture(scope="module")
def empty_room():
    return fill(box=False)


@pytest.mark.slow
def test_bare_walls_have_the_range_of_their_plane(empty_room):
    range_m, std_m, truth = empty_room
    walls = slice(70, 150)  # rows between the creases
    assert np.isfinite(range_m[walls]).mean() > 0.6
    known = np.isfinite(range_m)
    off = np.abs(range_m - truth)[known]
    assert np.mean(off > 3 * std_m[known]) <= 0.02
    assert np.mean(off > 0.1 * truth[known]) <= 0.005
    assert np.all(std_m[known] < 0.051 * range_m[known])


@pytest.mark.slow
def test_a_bare_box_before_a_wall_is_not_taken_for_the_wall():
    range_m, std_m, truth = fill(box=True)
    known = np.isfinite(range_m)
    assert known.mean() > 0.2
    assert np.mean(np.abs(range_m - truth)[known] > 3 * std_m[known]) <= 0.02


@pytest.mark.slow
def test_what_is_measured_stands_unless_it_contradicts_the_plane(empty_room):
    alone, _, truth = empty_room
    rng, params = np.random.default_rng(3), MatchParams()
    top, bottom = (see(height, rng, False)[0] for height in (0.0, -BASELINE_M))
    measured = truth.astype(np.float32)
    rim = np.zeros(measured.shape, np.bool_)
    rim[110:114] = True
    measured[rim] *= 0.7
    everywhere, search = np.ones(top.shape, np.bool_), disparities_of_ranges(WHOLE, BASELINE_M, params)
    measured[130:], measured[:100] = np.nan, np.nan  # enough of a region must be unknown, that it counts
    ranged = measured, 0.02 * measured
    found, _ = range_of_planes(top, bottom, ranged, everywhere, one_viewpoint(), search, params)
    right = ~rim & ~np.isnan(measured)
    assert not np.isfinite(found[right]).any()
    known = rim & np.isfinite(alone)
    assert np.isfinite(found[known]).mean() > 0.8
    assert np.isfinite(found[:60]).any()


def outline(rng, number=30):
    """Return directions and inverse ranges of pieces on a plane 2 m away, and their deviations."""
    rays = rng.normal([1.0, 0.0, 0.0], 0.4, (number, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    n = np.array([0.5, 0.05, -0.02])
    std = np.full(number, 0.01)
    return rays, rays @ n + rng.normal(0, std), std, n


def test_a_true_plane_is_found_with_its_covariance_and_seldom_refused():
    rng, errors, refused = np.random.default_rng(5), [], 0
    for _ in range(400):
        rays, inverse, std, n = outline(rng)
        found = _fit(rays, np.zeros_like(rays), inverse, std, 0.0)
        refused += found is None
        if found is not None:
            errors.append((found[0] - n) @ np.linalg.solve(found[1], found[0] - n))
    assert refused / 400 == pytest.approx(30 * 0.0027, abs=0.04)  # one of 30 pieces beyond 3 deviations is too many
    assert np.mean(errors) == pytest.approx(3.0, rel=0.2)  # a covariance is enlarged by the fit, never made smaller


def test_a_bend_and_a_plane_that_hangs_on_one_piece_are_refused():
    rng = np.random.default_rng(6)
    rays, inverse, std, _ = outline(rng)
    bent = inverse * np.where(rays[:, 1] > 0, 1.15, 1.0)
    assert _fit(rays, np.zeros_like(rays), bent, std, 0.0) is None
    line = rays * [1.0, 1.0, 0.0]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    line[0] = [0.6, 0.0, 0.8]
    assert _fit(line, np.zeros_like(line), 0.5 * line[:, 0], std, 0.0) is None


def test_pieces_are_matched_as_numpy_does():
    rng = np.random.default_rng(8)
    top, bottom = (cv2.GaussianBlur(rng.normal(100, 40, (40, 50)).astype(np.float32), (0, 0), 1.0) for _ in range(2))
    bottom[:-6] = top[6:]  # row v of the upper image is row v - 6 of the lower one
    places, masks = np.array([[15, 10], [20, 30]], np.int32), rng.random((2, 9, 9)) > 0.3
    costs, found = np.zeros(20), np.zeros((2, 7))
    match_outline(top, bottom, places, masks, -2, costs, found)
    for (row, column), mask, one in zip(places, masks, found, strict=True):
        part = top[row : row + 9, column : column + 9][mask]
        expected = []
        for d in range(-2, 18):
            off = bottom[row - d : row - d + 9, column : column + 9][mask] - part if row >= d else np.array([1e9, 0])
            expected.append(float(np.sum((off - off.mean()) ** 2)))
        order = np.argsort(expected)
        assert abs(one[0] - 6) < 0.5
        assert order[0] == 8
        assert one[1] == pytest.approx(expected[8], abs=1e-2)
        assert one[2] == pytest.approx(min(cost for k, cost in enumerate(expected) if abs(k - 8) > 2), rel=1e-4)
        assert one[3] == mask.sum()
        assert one[5] == pytest.approx(np.sum((part - part.mean()) ** 2), rel=1e-3)
