"""Only what is the same in both cameras is compared."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.stitching.overlaps import is_same_detail
from sphere_mapping.acquisition.stitching.strips import Block

DETAIL_WINDOW, FAINT_DETAIL, FLAT_DETAIL, MIN_CORRELATION = 7, 0.01, 0.04, 0.8


@pytest.fixture
def detail(rng):
    return np.kron(rng.normal(4.5, 0.3, (20, 30)), np.ones((2, 2))).astype(np.float32)


def test_a_block_around_the_seam_is_compared_by_what_both_see(rng, detail):
    """Against means of whole images: of a block that wraps around, its borders and holes."""
    other = detail + rng.normal(0, 0.2, detail.shape).astype(np.float32)
    block = Block(5, 40, 30, 45)
    both = rng.random((30, 45)) < 0.8
    one, two = (block.cut(plane).astype(np.float64) for plane in (detail, other))
    size = DETAIL_WINDOW, DETAIL_WINDOW

    def mean(plane):
        return cv2.blur(plane * both, size, borderType=cv2.BORDER_CONSTANT) / cv2.blur(
            both.astype(float), size, borderType=cv2.BORDER_CONSTANT
        )

    a, b = (mean(plane * plane) - mean(plane) ** 2 for plane in (one, two))
    product = mean(one * two) - mean(one) * mean(two)
    is_like = (product > MIN_CORRELATION * np.sqrt(a * b)) & (np.minimum(a, b) > FAINT_DETAIL**2)
    expected = both & (is_like | (np.maximum(a, b) < FLAT_DETAIL**2))
    chosen = np.argwhere(np.ones((30, 45))).astype(np.int32)
    assert 0.1 < expected.mean() < 0.7
    np.testing.assert_array_equal(is_same_detail(detail, other, both, block, chosen), expected.ravel())
