"""The rows of a pair that disagree are found and put right; a right pair is left alone."""

import cv2
import numpy as np

from sphere_mapping.acquisition.stereo.stereo_field import (
    StereoField,
    basis_of_columns,
    fit_rows,
    match_corners,
    slopes_of_columns,
    tangents,
)
from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid

CAMERA = Pinhole(480, 320, 360.0, 360.0, 239.5, 159.5)


def texture(seed):
    image = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, (320, 480)), (0, 0), 1.5)
    return np.clip(128 + 40 * image / image.std(), 1, 255).astype(np.uint8)


def drawn(image, correction, disparity, rng):
    """Return the right image of a plane of equal disparity, with noise, as a pair with this field gives it."""
    pixels = pixel_grid(CAMERA)
    at = pixels.copy()
    for _ in range(4):  # the true pixel of what is seen at each pixel
        at = pixels - np.stack(correction.shift(*tangents(CAMERA, at)), axis=-1)
    at[..., 0] += disparity
    seen = cv2.remap(image, at.astype(np.float32), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.clip(seen + rng.normal(0, 2, seen.shape), 0, 255).astype(np.uint8)


def test_rows_are_recovered_within_their_deviations(rng):
    rows = (0.3, -0.4, 0.2, 0.5, 6.8, -0.6)
    left = texture(1)
    fit = fit_rows(CAMERA, *match_corners(left, drawn(left, StereoField(rows=rows), 12.0, rng)))
    assert fit.is_significant
    assert fit.before_px > 0.3 > 2 * fit.after_px
    off = fit.rows - rows
    assert off @ np.linalg.solve(fit.covariance, off) < 40  # six numbers; errors of neighbours are not independent
    x, y = tangents(CAMERA, pixel_grid(CAMERA))
    assert np.abs(StereoField(rows=tuple(off)).shift(x, y)[1]).max() < 0.12  # px, the corners included


def test_rows_that_agree_are_left_alone():
    left = texture(0)
    right = drawn(left, StereoField(), 9.0, np.random.default_rng(0))
    fit = fit_rows(CAMERA, *match_corners(left, right))
    x, y = tangents(CAMERA, pixel_grid(CAMERA))
    worst = np.abs(StereoField(rows=tuple(fit.rows)).shift(x, y)[1]).max()
    assert not fit.is_significant or worst < 0.1


def test_slopes_of_the_columns_are_those_of_their_polynomial(rng):
    x, y = rng.uniform(-0.8, 0.8, (2, 20))
    by_x, by_y = slopes_of_columns(x, y)
    step = 1e-6
    for found, (dx, dy) in ((by_x, (step, 0.0)), (by_y, (0.0, step))):
        change = basis_of_columns(x + dx, y + dy) - basis_of_columns(x - dx, y - dy)
        np.testing.assert_allclose(found, change / (2 * step), atol=1e-8)
