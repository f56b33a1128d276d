"""Only what is the same in both cameras is compared."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.stitching.overlaps import is_same_detail

DETAIL_WINDOW, FAINT_DETAIL, FLAT_DETAIL, MIN_CORRELATION = 7, 0.01, 0.04, 0.8


@pytest.fixture
def detail(rng):
    return np.kron(rng.normal(4.5, 0.3, (20, 30)), np.ones((2, 2))).astype(np.float32)


def test_images_are_compared_by_what_both_see_around_a_place_also_over_the_seam(rng, detail):
    """Against means of whole images, continued over their seam: borders and holes count nothing."""
    other = detail + rng.normal(0, 0.2, detail.shape).astype(np.float32)
    both = rng.random(detail.shape) < 0.8
    pad, size = DETAIL_WINDOW, (DETAIL_WINDOW, DETAIL_WINDOW)
    one, two, seen = (np.pad(plane.astype(np.float64), ((0, 0), (pad, pad)), "wrap") for plane in (detail, other, both))

    def mean(plane):
        sums = (cv2.blur(part, size, borderType=cv2.BORDER_CONSTANT) for part in (plane * seen, seen))
        return np.divide(*sums)[:, pad:-pad]

    a, b = (mean(plane * plane) - mean(plane) ** 2 for plane in (one, two))
    product = mean(one * two) - mean(one) * mean(two)
    is_like = (product > MIN_CORRELATION * np.sqrt(a * b)) & (np.minimum(a, b) > FAINT_DETAIL**2)
    expected = both & (is_like | (np.maximum(a, b) < FLAT_DETAIL**2))
    assert 0.1 < expected.mean() < 0.7
    chosen = np.argwhere(np.ones(detail.shape))
    np.testing.assert_array_equal(is_same_detail(detail, other, both, chosen), expected.ravel())
